import { describe, expect, test } from "vitest";
import { attributeName, choice, flag, number, text } from "../../src/elements/base/attributes";
import { readable } from "../../src/elements/topic/readable";
import { numberAt, valueAt } from "../../src/robot/fields";

describe("attributes", () => {
  test("have the names of their properties, with hyphens", () => {
    expect(attributeName("maxLinear")).toBe("max-linear");
  });

  test.each([
    [number(5, 0, 10), "3", 3],
    [number(5, 0, 10), "11", 10],
    [number(5, 0, 10), "-Infinity", 0],
    [number(5, 0, 10), "fast", undefined],
    [number(5, 0, 10), " ", undefined],
    [flag(), "", true],
    [flag(), "false", false],
    [choice("focus", "page"), "page", "page"],
    [choice("focus", "page"), "never", undefined],
    [text("data"), "", ""],
  ])("%# read", (kind, written, value) => {
    expect(kind.read(written)).toBe(value);
  });

  test("are not written where they say what is so without them", () => {
    expect([
      number(5, 0, 10).write(5),
      flag().write(false),
      text().write(""),
      choice("a", "b").write("a"),
    ]).toEqual([null, null, null, null]);
    expect([number(5, 0, 10).write(6), flag().write(true), choice("a", "b").write("b")]).toEqual([
      "6",
      "",
      "b",
    ]);
  });
});

describe("paths", () => {
  const message = { pose: { position: { x: 1.5 } }, ranges: [1, 2, 3], flags: new Uint8Array([7, 8]) };

  test.each([
    ["pose.position.x", 1.5],
    ["ranges[1]", 2],
    ["ranges.2", 3],
    ["flags[1]", 8],
    ["pose.nothing", undefined],
    ["ranges[9]", undefined],
    ["constructor.name", undefined],
    ["ranges.length", 3],
  ])("%s", (path, value) => {
    expect(valueAt(message, path)).toBe(value);
  });

  test("the empty one is the message", () => {
    expect(valueAt(message, "")).toBe(message);
  });

  test.each([
    ["ranges[0]", 1],
    ["pose", Number.NaN],
    ["pose.nothing", Number.NaN],
  ])("%s as a number is %s", (path, number) => {
    expect(numberAt(message, path)).toBe(number);
  });
});

describe("a message in words", () => {
  test("has a line for each value, and few of what is long", () => {
    const message = {
      header: { frame_id: "map" },
      covariance: new Array(36).fill(0.5),
      points: [{ x: 1 }, { x: 2 }],
      data: new Uint8Array([1, 2]),
      text: "x".repeat(2000),
      nothing: null,
    };
    const lines = readable(message, 2).split("\n");
    expect(lines.slice(0, 2)).toEqual(["header:", "  frame_id: map"]);
    expect(lines[2]).toBe(`covariance: [${new Array(20).fill("0.50").join(", ")}, … 16 more]`);
    expect(lines.slice(3, 8)).toEqual(["points:", "  0:", "    x: 1", "  1:", "    x: 2"]);
    expect(lines[8]).toBe("data: [1, 2]");
    expect(lines[9]).toHaveLength("text: ".length + 501);
    expect(lines[10]).toBe("nothing: null");
  });

  test("of many values ends", () => {
    const many = Object.fromEntries(Array.from({ length: 5000 }, (_, index) => [`field_${index}`, index]));
    expect(readable(many, 3).split("\n")).toHaveLength(201);
  });
});
