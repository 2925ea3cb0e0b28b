import { describe, expect, test } from "vitest";
import { Delay } from "../src/robot/delay";

/** The delays of images 0.1 s apart, whose clock is so many seconds ahead and runs at a speed. */
function delaysOf(late: number[], ahead: number, speed = 1, hasRobotClock = true): number[] {
  const delay = new Delay();
  return late.map((seconds, index) => {
    const now = 100 + index * 0.1;
    const clock = (at: number) => ahead + at * speed;
    return delay.of(clock(now - seconds), now, hasRobotClock ? clock(now) : Number.NaN);
  });
}

describe("the delay of images", () => {
  test.each([0, 1.7e9, -50])("by stamps of a clock %d s ahead", (ahead) => {
    // A queue that grows: each image is 0.08 s later than the one before it; then it is empty.
    const late = [...Array.from({ length: 40 }, (_, count) => 0.05 + count * 0.08), 0.05];
    const delays = delaysOf(late, ahead);
    expect(delays[0]).toBe(0);
    expect(delays[39]).toBeCloseTo(39 * 0.08, 1);
    expect(delays[40]).toBeCloseTo(0, 2);
  });

  test("of a camera whose clock is wrong, and of a media clock", () => {
    for (const robot of [1e6, Number.NaN, -1e6]) {
      const delay = new Delay();
      expect(delay.of(10, 500, robot)).toBe(0);
      expect(delay.of(10.1, 502.1, robot)).toBeCloseTo(2, 2);
    }
  });

  test.each([0.2, 5])("in a simulation at speed %d nothing is old", (speed) => {
    const delays = delaysOf(new Array(300).fill(0.02), 1000, speed);
    expect(Math.max(...delays)).toBeLessThan(0.15);
  });

  test("a clock that is set back, or none, says nothing", () => {
    const delay = new Delay();
    expect([delay.of(1000, 1, Number.NaN), delay.of(10, 2, Number.NaN), delay.of(Number.NaN, 3, 5)]).toEqual([
      0, 0, 0,
    ]);
  });
});
