import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { loadLater, type Trouble } from "../src/forms/later";

let told: (Trouble | null)[];
let begun: string[];
let asked: number;

beforeEach(() => {
  vi.useFakeTimers();
  [told, begun, asked] = [[], [], 0];
});

afterEach(() => {
  vi.useRealTimers();
});

function load(come: () => Promise<string>, begin = (part: string) => void begun.push(part)): () => void {
  return loadLater(
    () => {
      asked++;
      return come();
    },
    (part) => {
      begin(part);
      return () => begun.push(`end of ${part}`);
    },
    (trouble) => told.push(trouble),
  );
}

test("a part that comes is begun with, and ended", async () => {
  const end = load(async () => "part");
  await vi.advanceTimersByTimeAsync(60_000);
  expect(begun).toEqual(["part"]);
  expect(told).toEqual([null]);
  end();
  expect(begun).toEqual(["part", "end of part"]);
});

test("a part that does not load is asked for again, and its trouble is over when it comes", async () => {
  load(async () => {
    if (asked < 3) throw new Error("no such file");
    return "part";
  });
  await vi.advanceTimersByTimeAsync(0);
  expect(told).toEqual([{ kind: "missing", reason: "no such file" }]);
  await vi.advanceTimersByTimeAsync(5000);
  expect(begun).toEqual(["part"]);
  expect(told.at(-1)).toBe(null);
});

test("a part that never loads stays said to be missing", async () => {
  load(() => Promise.reject(new Error("no such file")));
  await vi.advanceTimersByTimeAsync(60_000);
  expect(asked).toBe(3);
  expect(told.at(-1)).toEqual({ kind: "missing", reason: "no such file" });
});

test("a part that is late is said to be, and begun with all the same", async () => {
  let come: (part: string) => void = () => {};
  load(() => new Promise((tell) => (come = tell)));
  await vi.advanceTimersByTimeAsync(14_900);
  expect(told).toEqual([]);
  await vi.advanceTimersByTimeAsync(200);
  expect(told).toEqual([{ kind: "late", reason: "" }]);
  come("part");
  await vi.advanceTimersByTimeAsync(0);
  expect(told.at(-1)).toBe(null);
  expect(begun).toEqual(["part"]);
});

test("a part that fails as it begins is not asked for again", async () => {
  load(
    async () => "part",
    () => {
      throw new Error("no WebGL");
    },
  );
  await vi.advanceTimersByTimeAsync(60_000);
  expect(asked).toBe(1);
  expect(told.at(-1)).toEqual({ kind: "failed", reason: "no WebGL" });
});

test("nothing begins or is told after the end", async () => {
  let come: (part: string) => void = () => {};
  load(() => new Promise((tell) => (come = tell)))();
  come("part");
  await vi.advanceTimersByTimeAsync(60_000);
  expect([begun, told]).toEqual([[], []]);
});
