/**
 * Rates of topics, also of those that nothing subscribes to: each in turn is listened to for a moment.
 *
 * The server says no rates, and of a subscription with a throttle less arrives than is published. Topics with large
 * messages are left out: their rate is known while something shows them in full.
 */

import { type Signal, signal } from "@preact/signals-core";
import { shortType } from "./names";
import type { RobotSession } from "./session";

/** Milliseconds for which a topic is listened to, and how many at a time. */
const LISTEN = 2500;
const TOGETHER = 6;
/** Rates of the past that are kept. */
const KEPT = 24;
const LARGE =
  /^(sensor_msgs\/(PointCloud2|Image|CompressedImage)|nav_msgs\/OccupancyGrid|.*\/(Meshes|MarkerArray|Audio\w*))$/;

/** Measured rate of a topic. */
export interface Rate {
  /** Messages a second; 0 if none came while it was listened to. */
  hz: number;
  /** Earlier ones, the oldest first. */
  past: readonly number[];
}

export class Rates {
  readonly known: Signal<ReadonlyMap<string, Rate>> = signal(new Map());
  /** Lists of topics whose rates are wanted. */
  private readonly wanted = new Set<readonly string[]>();
  private next = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private ends: (() => void)[] = [];

  constructor(private readonly session: RobotSession) {}

  /** Measure the rates of these topics until the returned function is called. */
  watch(topics: readonly string[]): () => void {
    this.wanted.add(topics);
    if (this.timer === undefined) this.turn();
    return () => {
      this.wanted.delete(topics);
      if (!this.wanted.size) this.rest();
    };
  }

  private rest(): void {
    clearTimeout(this.timer);
    this.timer = undefined;
    for (const end of this.ends) end();
    this.ends = [];
  }

  private turn(): void {
    const { session } = this;
    const counts = new Map<string, number>();
    const listens = document.hidden || session.state.peek() !== "open" ? [] : this.pick();
    this.ends = listens.map((topic) => {
      counts.set(topic, 0);
      let isFirst = true;
      const type = session.graph.peek().topics.get(topic) ?? "";
      return session.subscribe(topic, type, () => {
        // The first one may be a latched one, or kept from before.
        if (!isFirst) counts.set(topic, (counts.get(topic) ?? 0) + 1);
        isFirst = false;
      });
    });
    const began = performance.now();
    this.timer = setTimeout(() => {
      const seconds = (performance.now() - began) / 1000;
      this.rest();
      const known = new Map(this.known.peek());
      for (const [topic, count] of counts) {
        const past = known.get(topic)?.past ?? [];
        const hz = count / seconds;
        known.set(topic, { hz, past: [...past, hz].slice(-KEPT) });
      }
      this.known.value = known;
      this.turn();
    }, LISTEN);
  }

  /** The topics that are next. */
  private pick(): string[] {
    const { session } = this;
    const { topics } = session.graph.peek();
    const able = [...new Set([...this.wanted].flat())].filter(
      (name) => session.may("subscribe", name) && !LARGE.test(shortType(topics.get(name) ?? "")),
    );
    if (able.length === 0) return [];
    const from = this.next % able.length;
    this.next = from + TOGETHER;
    return [...able.slice(from), ...able.slice(0, from)].slice(0, TOGETHER);
  }
}
