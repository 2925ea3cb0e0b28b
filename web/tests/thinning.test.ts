import { describe, expect, test } from "vitest";
import { Thinning } from "../src/scene/thinning";

/** A robot whose clouds have so many points: numbers of points of those that arrive. */
function robot(thinning: Thinning, whole: number, isOrganised = false, late = 0) {
  const strides = Array<number>(late).fill(thinning.stride);
  return () => {
    strides.push(thinning.stride);
    const stride = strides.shift() as number;
    const points = Math.ceil(whole / (isOrganised ? stride * stride : stride));
    thinning.heard(points, isOrganised);
    return points;
  };
}

const many = (times: number, act: () => number) => Array.from({ length: times }, act);

describe("points that the server is asked for", () => {
  test.each([
    [50_000, true, false, 1],
    [300_000, true, false, 8],
    [2_000_000, true, false, 64],
    [300_000, true, true, 4],
    [300_000, false, false, 1],
    [2_000_000, false, false, 4],
  ])("of %d are as many as are drawn", (whole, isSoftware, isOrganised, stride) => {
    const thinning = new Thinning(isSoftware);
    const points = many(20, robot(thinning, whole, isOrganised));
    expect(thinning.stride).toBe(stride);
    expect(thinning.oneOf).toBe(isOrganised ? stride * stride : stride);
    expect(points.at(-1)).toBeLessThanOrEqual(isSoftware ? 50_000 : 500_000);
  });

  test("do not change for clouds that were on the way", () => {
    const thinning = new Thinning(true);
    many(20, robot(thinning, 300_000, false, 4));
    expect(thinning.stride).toBe(8);
  });

  test("are more again where clouds become small, and do not change to and fro", () => {
    const thinning = new Thinning(true);
    many(20, robot(thinning, 300_000));
    many(20, robot(thinning, 90_000));
    expect(thinning.stride).toBe(4);
    const steady = many(100, robot(thinning, 110_000)).slice(20);
    expect(new Set(steady).size).toBe(1);
    many(40, robot(thinning, 5000));
    expect(thinning.stride).toBe(1);
  });

  test("have a bound however large a cloud says that it is", () => {
    const thinning = new Thinning(true);
    for (let cloud = 0; cloud < 40; cloud++) thinning.heard(Number.POSITIVE_INFINITY, false);
    expect(thinning.stride).toBe(4096);
  });
});
