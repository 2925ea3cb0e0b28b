import { describe, expect, test } from "vitest";
import { Governor } from "../src/scene/governor";
import type { Quality } from "../src/scene/quality";

/** A machine that needs so many milliseconds for a picture, and more for each thousand points and pixels. */
function machine(governor: Governor, cost: { pixels: number; points: number }, cloud = 100_000) {
  return () => {
    const { ratio, points } = governor.detail;
    const took = cost.pixels * ratio * ratio + (cost.points * Math.min(points, cloud)) / 1000;
    governor.drew(took);
    return took;
  };
}

const many = (times: number, act: () => number) => Array.from({ length: times }, act);

describe("how finely a moving scene is drawn", () => {
  test("a fast machine draws everything, as finely as its screen is", () => {
    const governor = new Governor("auto", 1.25, false);
    many(500, machine(governor, { pixels: 2, points: 0.01 }));
    expect(governor.detail).toEqual({ ratio: 1.25, points: Number.POSITIVE_INFINITY });
  });

  test("a slow one soon draws as much as it manages, and seldom tries more", () => {
    const governor = new Governor("auto", 1, false);
    const took = many(2000, machine(governor, { pixels: 10, points: 1 }));
    expect(took[0]).toBeGreaterThan(100);
    expect(took.slice(40).filter((each) => each > 20).length).toBeLessThan(60);
    expect(governor.detail.points).toBeGreaterThan(5000);
    expect(governor.detail.points).toBeLessThan(20_000);
  });

  test("what hinders it for a while costs fineness for a while", () => {
    const governor = new Governor("auto", 1, false);
    many(60, machine(governor, { pixels: 60, points: 5 }));
    expect(governor.detail).toEqual({ ratio: 0.5, points: 3000 });
    many(1000, machine(governor, { pixels: 1, points: 0.01 }));
    expect(governor.detail).toEqual(governor.best);
  });

  test("without a graphics card it begins with little, and a scene at rest is whole all the same", () => {
    const governor = new Governor("auto", 2, true);
    expect(governor.detail).toEqual({ ratio: 0.75, points: 12_000 });
    expect(governor.best).toEqual({ ratio: 2, points: Number.POSITIVE_INFINITY });
  });

  test.each<[Quality, number, boolean, { ratio: number; points: number }]>([
    ["low", 2, false, { ratio: 0.5, points: 6000 }],
    ["high", 2, true, { ratio: 2, points: Number.POSITIVE_INFINITY }],
    ["high", 1, true, { ratio: 1, points: Number.POSITIVE_INFINITY }],
    ["low", 0.3, true, { ratio: 0.3, points: 6000 }],
  ])(
    "%s at a screen of %d is what was asked for, however long it takes",
    (quality, finest, software, detail) => {
      const governor = new Governor(quality, finest, software);
      many(100, machine(governor, { pixels: 500, points: 50 }));
      many(500, machine(governor, { pixels: 0.1, points: 0 }));
      expect(governor.detail).toEqual(detail);
      expect(governor.best).toEqual(detail);
    },
  );
});
