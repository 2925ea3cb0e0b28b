/** Round trips that tell whether the robot still answers, and what its clock says. */

/** Milliseconds between two beats. */
export const BEAT = 200;
/** Milliseconds without an answer after which commands are held back. */
export const SILENT = 500;
/** Milliseconds without an answer, and without any other message, after which the connection is given up. */
export const GIVE_UP = 10_000;
/** Beats that may be unanswered at a time: a stalled connection delivers all of them when it recovers. */
const MOST_PENDING = 5;
/** Answers among which the one with the shortest round trip tells the clock's offset. */
const CLOCK_WINDOW = 25;

/** A call that every rosbridge server with rosapi answers, for every role. */
export const BEAT_SERVICE = "/rosapi/get_time";
const BEAT_ID = "rwt:beat:";

/** Responsiveness of the robot. */
export interface Answering {
  /** Milliseconds for which the robot has not answered; 0 while it answers in time. */
  silence: number;
  /** Milliseconds by which the robot's clock is ahead of this page's. */
  clockOffset: number;
  /** Milliseconds that the last answer took; 0 before the first. */
  trip: number;
}

interface Answer {
  op: string;
  id?: string;
  result?: boolean;
  values?: { time?: Record<string, number> };
}

/**
 * Beats of one connection.
 *
 * States: waiting for the first answer; beating; off, if the server has no such service. Only while beating can there
 * be silence. Messages behind a full queue are late as well, so what counts is the larger of two times: since the
 * last answer, and since the oldest unanswered beat beyond the shortest round trip.
 *
 * Times are milliseconds of a clock that never steps, as `performance.now()`.
 */
export class Liveness {
  private readonly pending = new Map<string, number>();
  private readonly clocks: { trip: number; offset: number }[] = [];
  private state: "waiting" | "beating" | "off" = "waiting";
  private count = 0;
  private shortest = Number.POSITIVE_INFINITY;
  private answeredAt = 0;
  private trip = 0;
  private beatAt = Number.NEGATIVE_INFINITY;
  private heardAt: number;

  constructor(now: number) {
    this.heardAt = now;
  }

  /** The text of a beat if one is due. */
  beat(now: number): string | null {
    if (this.state === "off" || now - this.beatAt < BEAT || this.pending.size >= MOST_PENDING) return null;
    this.beatAt = now;
    const id = BEAT_ID + ++this.count;
    this.pending.set(id, now);
    return JSON.stringify({ op: "call_service", id, service: BEAT_SERVICE, args: {} });
  }

  /** Take note that something came from the robot. */
  noteTraffic(now: number): void {
    this.heardAt = now;
  }

  /**
   * Take note of a message from the robot.
   *
   * @param wall milliseconds since 1970, to compare with the robot's clock
   * @returns true if it answers a beat, and is of no interest to others
   */
  hear(message: Answer, now: number, wall: number): boolean {
    this.noteTraffic(now);
    const { op, id = "", result, values } = message;
    if (op !== "service_response" || !id.startsWith(BEAT_ID)) return false;
    const sentAt = this.pending.get(id);
    this.pending.delete(id);
    if (result === false) this.state = "off";
    if (sentAt === undefined || this.state === "off") return true;
    this.state = "beating";
    this.answeredAt = now;
    const trip = now - sentAt;
    this.trip = trip;
    this.shortest = Math.min(this.shortest, trip);
    const { sec, secs, nanosec, nsecs } = values?.time ?? {};
    const robot = Number(sec ?? secs) * 1000 + Number(nanosec ?? nsecs) / 1e6;
    if (Number.isFinite(robot)) {
      this.clocks.push({ trip, offset: robot - (wall - trip / 2) });
      if (this.clocks.length > CLOCK_WINDOW) this.clocks.shift();
    }
    return true;
  }

  /** Current responsiveness. */
  answering(now: number): Answering {
    const oldest = this.pending.values().next().value;
    const late = oldest === undefined ? 0 : now - oldest - this.shortest;
    const silence = this.state === "beating" ? Math.max(now - this.answeredAt, late) : 0;
    const best = this.clocks.reduce<{ trip: number; offset: number } | null>(
      (one, other) => (one && one.trip <= other.trip ? one : other),
      null,
    );
    return { silence: silence > SILENT ? silence : 0, clockOffset: best?.offset ?? 0, trip: this.trip };
  }

  /** Return true if the connection has been silent for so long that another one is tried. */
  isDead(now: number): boolean {
    return this.state === "beating" && now - this.heardAt > GIVE_UP;
  }
}
