/** Messages as text for people. */

/** Items of a list, characters of a text, and lines, that are shown. */
const MOST_ITEMS = 20;
const MOST_CHARACTERS = 500;
const MOST_LINES = 200;

/** A message as lines, `name: value`, what belongs to a name further to the right; as much as people can read. */
export function readable(value: unknown, digits: number): string {
  const lines: string[] = [];
  write(value, "", "", digits, lines);
  if (lines.length > MOST_LINES) lines.splice(MOST_LINES, lines.length, "…");
  return lines.join("\n");
}

function write(value: unknown, name: string, indent: string, digits: number, lines: string[]): void {
  if (lines.length > MOST_LINES) return;
  const label = name ? `${indent}${name}:` : "";
  const line = (text: string) => lines.push(label ? `${label} ${text}` : `${indent}${text}`);
  if (value === null || typeof value !== "object") {
    line(plain(value, digits));
    return;
  }
  const items = listOf(value);
  if (items) {
    const { length } = items;
    const shown = Array.from(items.slice(0, MOST_ITEMS) as ArrayLike<unknown>);
    const rest = length > MOST_ITEMS ? `, … ${length - MOST_ITEMS} more` : "";
    if (shown.every((item) => item === null || typeof item !== "object")) {
      line(`[${shown.map((item) => plain(item, digits)).join(", ")}${rest}]`);
      return;
    }
    if (label) lines.push(label);
    shown.forEach((item, index) => {
      write(item, `${index}`, `${indent}  `, digits, lines);
    });
    if (rest) lines.push(`${indent}  ${rest.slice(2)}`);
    return;
  }
  if (label) lines.push(label);
  const inner = label ? `${indent}  ` : indent;
  for (const [key, item] of Object.entries(value)) write(item, key, inner, digits, lines);
}

function listOf(value: object): { length: number; slice(from: number, to: number): unknown } | null {
  if (Array.isArray(value)) return value;
  return ArrayBuffer.isView(value) && "slice" in value ? (value as Uint8Array) : null;
}

function plain(value: unknown, digits: number): string {
  if (typeof value === "number" && !Number.isInteger(value)) return value.toFixed(digits);
  const text = String(value);
  return text.length > MOST_CHARACTERS ? `${text.slice(0, MOST_CHARACTERS)}…` : text;
}
