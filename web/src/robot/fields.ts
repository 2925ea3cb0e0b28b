/** Values in messages by their paths, such as `pose.position.x` or `ranges.3`. */

const MOST_PATHS = 400;
const MOST_ITEMS = 32;
const MOST_DEPTH = 8;

/** The steps of a path, in which an item of a list is `ranges.3` or `ranges[3]`; none for the whole message. */
function pathSteps(path: string): string[] {
  return path.split(/[.[\]]+/).filter((step) => step !== "");
}

/** Value at a path; undefined if there is none. */
export function valueAt(message: unknown, path: string): unknown {
  let value = message;
  for (const step of pathSteps(path)) {
    if (value === null || typeof value !== "object" || !Object.hasOwn(value, step)) return undefined;
    value = (value as Record<string, unknown>)[step];
  }
  return value;
}

/** The value at a path as a number; NaN for what is none. */
export function numberAt(message: unknown, path: string): number {
  const value = valueAt(message, path);
  if (typeof value === "number") return value;
  return typeof value === "boolean" ? Number(value) : Number.NaN;
}

/** The paths of all numbers in a message; of long lists the first ones. */
export function numericPaths(message: unknown): string[] {
  return pathsOf(message, ["number", "boolean"]);
}

/** The paths of all plain values in a message; of long lists the first ones. */
export function leafPaths(message: unknown): string[] {
  return pathsOf(message, ["number", "boolean", "string"]);
}

/** A field of a message, and its value in an earlier one. */
export interface Change {
  path: string;
  value: unknown;
  earlier: unknown;
}

/** The plain values whose paths contain a text; beside an earlier message, only those that differ from it. */
export function selectedFields(message: unknown, text: string, earlier?: unknown): Change[] {
  const wanted = text.toLowerCase();
  return pathsOf(message, ["number", "boolean", "string", "bigint", "null"])
    .filter((path) => path.toLowerCase().includes(wanted))
    .map((path) => ({ path, value: valueAt(message, path), earlier: valueAt(earlier, path) }))
    .filter((field) => earlier === undefined || !Object.is(field.value, field.earlier));
}

function pathsOf(message: unknown, types: readonly string[]): string[] {
  const found: string[] = [];
  const walk = (value: unknown, path: string, depth: number) => {
    if (found.length >= MOST_PATHS || depth > MOST_DEPTH) return;
    if (types.includes(value === null ? "null" : typeof value)) {
      found.push(path);
      return;
    }
    if (value === null || typeof value !== "object") return;
    const entries =
      Array.isArray(value) || ArrayBuffer.isView(value)
        ? Array.from({ length: Math.min((value as unknown[]).length, MOST_ITEMS) }, (_, at) => String(at))
        : Object.keys(value).filter((name) => !name.startsWith("$"));
    for (const name of entries) {
      walk((value as Record<string, unknown>)[name], path ? `${path}.${name}` : name, depth + 1);
    }
  };
  walk(message, "", 0);
  return found;
}
