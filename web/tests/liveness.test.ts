import { describe, expect, test } from "vitest";
import { BEAT, GIVE_UP, Liveness, SILENT } from "../src/decode/liveness";

/** A robot at the other end of a line with a delay, which can be cut. */
class Line {
  now = 5000;
  beats = 0;
  private readonly liveness = new Liveness(this.now);
  private readonly queue: { at: number; id: string }[] = [];

  /** @param ahead milliseconds by which the robot's clock is ahead */
  constructor(
    public delay: number,
    private readonly ahead = 0,
    private readonly result = true,
  ) {}

  /** Let time pass, and return the longest silence of it. */
  pass(milliseconds: number, isCut = false): number {
    let longest = 0;
    for (const end = this.now + milliseconds; this.now < end; this.now += 10) {
      const beat = this.liveness.beat(this.now);
      if (beat) {
        this.beats++;
        this.queue.push({ at: this.now + this.delay, id: (JSON.parse(beat) as { id: string }).id });
      }
      while (!isCut && this.queue[0] && this.queue[0].at <= this.now) {
        const { at, id } = this.queue.shift() as { at: number; id: string };
        const robot = 1000 + at - this.delay / 2 + this.ahead;
        const time = { sec: Math.floor(robot / 1000), nanosec: Math.round((robot % 1000) * 1e6) };
        const { result } = this;
        const answer = { op: "service_response", id, result, values: { time } };
        expect(this.liveness.hear(answer, this.now, 1000 + this.now)).toBe(true);
      }
      longest = Math.max(longest, this.liveness.answering(this.now).silence);
    }
    return longest;
  }

  get answering() {
    return this.liveness.answering(this.now);
  }

  get isDead() {
    return this.liveness.isDead(this.now);
  }
}

describe("liveness of a connection", () => {
  test.each([0, 50, 600])("a line with a delay of %d ms is not silent", (delay) => {
    const line = new Line(delay);
    line.pass(delay + 100);
    expect(line.pass(5000)).toBe(0);
    expect(line.beats).toBeLessThanOrEqual((5000 + delay + 100) / BEAT + 1);
  });

  test("a cut line is silent after half a second, with a figure that grows, until it answers", () => {
    const line = new Line(20);
    line.pass(1000);
    expect(line.pass(SILENT - BEAT - 50, true)).toBe(0);
    line.pass(BEAT + 100, true);
    expect(line.answering.silence).toBeGreaterThan(SILENT);
    line.pass(1000, true);
    expect(line.answering.silence).toBeGreaterThan(1500);
    line.pass(20);
    expect(line.answering.silence).toBe(0);
  });

  test("a queue that grows is silence, though answers arrive", () => {
    const line = new Line(20);
    line.pass(1000);
    line.delay = 1500;
    line.pass(1600);
    expect(line.pass(1000)).toBeGreaterThan(SILENT);
  });

  test("few beats wait at a cut line", () => {
    const line = new Line(20);
    line.pass(1000);
    const { beats } = line;
    line.pass(10_000, true);
    expect(line.beats - beats).toBeLessThanOrEqual(5);
  });

  test("the connection is given up when nothing at all arrives", () => {
    const line = new Line(20);
    line.pass(1000);
    line.pass(GIVE_UP - 500, true);
    expect(line.isDead).toBe(false);
    line.pass(1000, true);
    expect(line.isDead).toBe(true);
  });

  test("the robot's clock is known", () => {
    const line = new Line(80, 3_600_000);
    line.pass(2000);
    expect(Math.abs(line.answering.clockOffset - 3_600_000)).toBeLessThanOrEqual(10);
  });

  test("a server without such a service is asked once, and never silent", () => {
    const line = new Line(20, 0, false);
    line.pass(1000);
    expect(line.beats).toBe(1);
    expect(line.pass(20_000, true)).toBe(0);
    expect(line.isDead).toBe(false);
  });
});
