/** Numbers computed from messages: a path, and functions behind it, such as `linear.@norm.@mul(3.6)`. */

import { MessagePath } from "./message_path";

/** Numbers of a list, or of the fields of a message. */
function numbersOf(value: unknown): number[] {
  if (value === null || typeof value !== "object") return [];
  const all = ArrayBuffer.isView(value) ? (value as unknown as ArrayLike<number>) : Object.values(value);
  return Array.from(all as ArrayLike<unknown>).filter((each): each is number => typeof each === "number");
}

const OF_PARTS: Record<string, (numbers: number[], value: unknown) => number> = {
  norm: (numbers) => (numbers.length ? Math.hypot(...numbers.slice(0, 16)) : Number.NaN),
  length: (_, value) => Number((value as { length?: number } | null)?.length ?? Number.NaN),
  min: (numbers) => numbers.reduce((one, other) => Math.min(one, other), Number.POSITIVE_INFINITY),
  max: (numbers) => numbers.reduce((one, other) => Math.max(one, other), Number.NEGATIVE_INFINITY),
  mean: (numbers) => numbers.reduce((sum, each) => sum + each, 0) / numbers.length,
  yaw: (_, value) => {
    const { x, y, z, w } = (value ?? {}) as Record<string, number>;
    return Math.atan2(
      2 * (Number(w) * Number(z) + Number(x) * Number(y)),
      1 - 2 * (Number(y) ** 2 + Number(z) ** 2),
    );
  },
};

const OF_NUMBERS: Record<string, (value: number) => number> = {
  abs: Math.abs,
  negative: (value) => -value,
  round: Math.round,
  sqrt: Math.sqrt,
  sin: Math.sin,
  cos: Math.cos,
  degrees: (value) => (value * 180) / Math.PI,
  radians: (value) => (value * Math.PI) / 180,
};

const WITH_ARGUMENT: Record<string, (value: number, by: number) => number> = {
  add: (value, by) => value + by,
  sub: (value, by) => value - by,
  mul: (value, by) => value * by,
  div: (value, by) => value / by,
};

/** Functions of the value before, too. */
const OVER_TIME: Record<string, (value: number, before: number, seconds: number) => number> = {
  delta: (value, before) => value - before,
  derivative: (value, before, seconds) => (seconds > 0 ? (value - before) / seconds : Number.NaN),
};

/** Names of all functions, as they are written. */
export const FUNCTIONS: readonly string[] = [
  ...Object.keys({ ...OVER_TIME, ...OF_PARTS, ...OF_NUMBERS }).map((name) => `@${name}`),
  ...Object.keys(WITH_ARGUMENT).map((name) => `@${name}(1)`),
];

type Step = (value: unknown, time: number) => number;

function step(text: string): Step {
  const [, name = "", , argument] = /^@(\w+)(\(([^()]*)\))?$/.exec(text) ?? [];
  const own = <T>(table: Record<string, T>) => (Object.hasOwn(table, name) ? table[name] : undefined);
  const parts = own(OF_PARTS);
  const plain = own(OF_NUMBERS);
  const binary = own(WITH_ARGUMENT);
  const timed = own(OVER_TIME);
  if (binary) {
    const by = Number(argument);
    if (!argument?.trim() || !Number.isFinite(by)) throw new Error(`@${name} needs a number: @${name}(2)`);
    return (value) => binary(asNumber(value), by);
  }
  if (argument !== undefined || !(parts || plain || timed)) throw new Error(`unknown function ${text}`);
  if (parts) return (value) => parts(numbersOf(value), value);
  if (plain) return (value) => plain(asNumber(value));
  let before = Number.NaN;
  let at = Number.NaN;
  return (value, time) => {
    const now = asNumber(value);
    const result = timed?.(now, before, time - at) ?? Number.NaN;
    [before, at] = [now, time];
    return result;
  };
}

function asNumber(value: unknown): number {
  if (typeof value === "number") return value;
  if (typeof value === "bigint" || typeof value === "boolean") return Number(value);
  return Number.NaN;
}

/** Number of each message of one topic; keeps the value before for functions over time. */
export class Formula {
  /** Path in front of the functions. */
  readonly path: string;
  private readonly place: MessagePath;
  private readonly steps: Step[];

  /** @throws Error the path is none, or a function is unknown or lacks its number; the text names it */
  constructor(text: string) {
    // Texts in filters may hold any character.
    const at = text.replace(/\{[^}]*\}/g, (filter) => "_".repeat(filter.length)).indexOf("@");
    this.path = (at < 0 ? text : text.slice(0, at)).replace(/\.$/, "");
    this.place = new MessagePath(this.path);
    this.steps = at < 0 ? [] : (text.slice(at).match(/[^.(]+(\([^)]*\)?)?/g) ?? []).map(step);
  }

  /** The number of a message that arrived at a time in seconds; NaN for none. */
  numberOf(message: unknown, time: number): number {
    let value = this.place.valueIn(message);
    for (const each of this.steps) value = each(value, time);
    return asNumber(value);
  }
}

/** Error in a formula, for people; empty if it is valid. */
export function formulaProblem(text: string): string {
  try {
    new Formula(text);
    return "";
  } catch (error) {
    return (error as Error).message;
  }
}
