/**
 * Paths with slices and filters, as Foxglove and Lichtblick write them: `ranges[0:9]`, `markers[:]{id==1}.pose.position.x`.
 * An item is `list[3]`, `list.3`, or from the end `list[-1]`; both ends belong to a slice.
 */

/** Values that a path yields at most. */
const MOST_VALUES = 10_000;

type Step = (value: unknown) => unknown[];

const TOKENS: readonly [RegExp, (found: RegExpExecArray) => Step][] = [
  [/\.?\[(-?\d+)\]/y, ([, at]) => sliceOf(Number(at), Number(at))],
  [/\.?\[(-?\d*):(-?\d*)\]/y, ([, from, to]) => sliceOf(Number(from || 0), Number(to || -1))],
  [
    /\{\s*([^{}=!<>\s]+)\s*(==|!=|<=|>=|<|>)\s*("[^"]*"|'[^']*'|[^{}"'\s]+)\s*\}/y,
    ([, path, sign, value]) => filterOf(path as string, sign as string, value as string),
  ],
  [/\.?([^.[\]{}]+)/y, ([, name]) => memberOf(name as string)],
];

/** One path, which is read from many messages. */
export class MessagePath {
  private readonly steps: Step[] = [];
  /** True if it may yield several values. */
  private readonly isMany: boolean;

  /** @throws Error what is no path; the text names it */
  constructor(text: string) {
    for (let at = 0; at < text.length; ) {
      const length = this.parse(text, at);
      if (!length) throw new Error(`no path at ${text.slice(at)}`);
      at += length;
    }
    this.isMany = /\[[^\]]*:|\{/.test(text);
  }

  /** The value at this path, which for slices and filters is the list of all; undefined if there is none. */
  valueIn(message: unknown): unknown {
    let values = [message];
    for (const step of this.steps) values = after(step, values);
    return this.isMany && values.length !== 1 ? values : values[0];
  }

  /** Take one step of the text; the number of its characters, 0 for none. */
  private parse(text: string, at: number): number {
    for (const [token, make] of TOKENS) {
      token.lastIndex = at;
      const found = token.exec(text);
      if (!found) continue;
      this.steps.push(make(found));
      return found[0].length;
    }
    return 0;
  }
}

/** What a step finds in values: of very many the first, without a look at the others. */
function after(step: Step, values: readonly unknown[]): unknown[] {
  const found: unknown[] = [];
  for (const value of values) {
    if (found.length >= MOST_VALUES) break;
    found.push(...step(value).slice(0, MOST_VALUES - found.length));
  }
  return found;
}

function memberOf(name: string): Step {
  return (value) => {
    if (value === null || typeof value !== "object" || !Object.hasOwn(value, name)) return [];
    return [(value as Record<string, unknown>)[name]];
  };
}

function sliceOf(from: number, to: number): Step {
  return (value) => {
    if (!Array.isArray(value) && !ArrayBuffer.isView(value)) return [];
    const list = value as ArrayLike<unknown>;
    const first = from < 0 ? list.length + from : from;
    const last = Math.min(
      to < 0 ? list.length + to : to,
      list.length - 1,
      Math.max(0, first) + MOST_VALUES - 1,
    );
    if (first < 0 && from === to) return [];
    return Array.from(
      { length: Math.max(0, last - Math.max(0, first) + 1) },
      (_, at) => list[Math.max(0, first) + at],
    );
  };
}

const COMPARE: Record<string, (one: never, other: never) => boolean> = {
  "==": (one, other) => one === other,
  "!=": (one, other) => one !== other,
  "<": (one, other) => one < other,
  "<=": (one, other) => one <= other,
  ">": (one, other) => one > other,
  ">=": (one, other) => one >= other,
};

function filterOf(path: string, sign: string, text: string): Step {
  const wanted = literal(text);
  const inner = new MessagePath(path);
  const compare = COMPARE[sign] as (one: unknown, other: unknown) => boolean;
  return (value) => {
    const found = inner.valueIn(value);
    const plain = typeof found === "bigint" ? Number(found) : found;
    return typeof plain === typeof wanted && compare(plain, wanted) ? [value] : [];
  };
}

/** A number, a truth value, or a text in quotes. */
function literal(text: string): string | number | boolean {
  if (/^["']/.test(text)) return text.slice(1, -1);
  if (text === "true" || text === "false") return text === "true";
  const number = Number(text);
  if (Number.isNaN(number)) throw new Error(`${text} is no number, true, false, or text in quotes`);
  return number;
}
