/** The tf tree as messages tell it: rates and delays by their stamps, and what is wrong with the tree. */

import { frameName, seconds } from "./names";

/** A transform as a message of /tf has it. */
export interface Transform {
  header?: { frame_id?: string; stamp?: unknown };
  child_frame_id?: string;
  transform?: { translation?: { x: number; y: number; z: number } };
}

/** What is wrong with a tree; `frames` are those that it is about. */
export type TreeFault =
  /** Frames of which each is the parent of the next, and the last one that of the first. */
  | { kind: "loop"; frames: string[] }
  /** A frame, and the parents that it has. */
  | { kind: "parents"; frames: string[]; parents: string[] }
  /** Roots of trees that nothing connects. */
  | { kind: "islands"; frames: string[] }
  /** Stamps behind the robot's clock, or ahead of it; the number is the mean in seconds. */
  | { kind: "old" | "future"; frames: string[]; number: number }
  /** Stamps that went back, or places far from the last one; the number is how often. */
  | { kind: "back" | "jump"; frames: string[]; number: number }
  /** There are more frames than are kept; the number is the maximum. */
  | { kind: "full"; frames: string[]; number: number };

/** Stamps that are kept of a frame, and seconds over which they are counted. */
const KEPT = 128;
const WINDOW_S = 5;
/** Frames, and parents of one of them, at most. */
const MOST_FRAMES = 2000;
const MOST_PARENTS = 8;
/** Seconds after which a parent that is no longer told does not count. */
const PARENT_S = 10;
/** Mean seconds of a stamp behind the robot's clock from which it is old; localization tells up to one second ahead. */
const OLD_S = 1;
const FUTURE_S = 2;
/** Metres between two places from which they are a jump, if they are also so many times the usual distance apart. */
const JUMP_M = 1;
const JUMP_TIMES = 10;

/** The rate of something by the stamps of its messages. */
export class StampRate {
  private readonly stamps = new Float64Array(KEPT);
  private count = 0;

  /** Take note of a stamp in seconds; one that is not later than the last one does not count. */
  push(stamp: number): void {
    if (this.count > 0 && stamp <= this.last) return;
    this.stamps[this.count++ % KEPT] = stamp;
  }

  /** Forget all stamps. */
  clear(): void {
    this.count = 0;
  }

  /** The last stamp; NaN before the first. */
  get last(): number {
    return this.count ? (this.stamps[(this.count - 1) % KEPT] as number) : Number.NaN;
  }

  /** Messages a second over the last seconds, or from the one before to the last; 0 before the second message. */
  get hz(): number {
    const kept = Math.min(this.count, KEPT);
    let first = this.last;
    let found = 1;
    for (; found < kept; found++) {
      const stamp = this.stamps[(this.count - 1 - found) % KEPT] as number;
      if (found > 1 && this.last - stamp > WINDOW_S) break;
      first = stamp;
    }
    return this.last > first ? (found - 1) / (this.last - first) : 0;
  }
}

/** One frame. */
export class TreeFrame {
  /** Last time in seconds, by the robot's clock, at which each parent was told; the last one is the last of the map. */
  readonly parents = new Map<string, number>();
  readonly rate = new StampRate();
  /** Seconds by the robot's clock when the last transform came. */
  at = 0;
  /** Mean seconds from the stamp to the arrival. */
  delay = 0;
  backs = 0;
  jumps = 0;
  private place: { x: number; y: number; z: number } | null = null;
  private step = 0;

  constructor(readonly isStatic: boolean) {}

  /** The parent that was told last. */
  get parent(): string {
    return [...this.parents.keys()].at(-1) ?? "";
  }

  take(
    parent: string,
    stamp: number,
    now: number,
    place: { x: number; y: number; z: number } | undefined,
  ): void {
    this.parents.delete(parent);
    this.parents.set(parent, now);
    for (const [name, at] of this.parents) {
      if (now - at > PARENT_S || this.parents.size > MOST_PARENTS) this.parents.delete(name);
    }
    const isFirst = this.at === 0;
    this.at = now;
    if (this.isStatic) return;
    // A stamp of zero, or none, says nothing: the time of the arrival is what there is.
    const told = stamp > 0 ? stamp : now;
    this.delay = isFirst ? now - told : this.delay * 0.9 + 0.1 * (now - told);
    if (told < this.rate.last) {
      this.backs++;
      // Several parents have stamps of their own.
      if (this.parents.size === 1) this.rate.clear();
    }
    this.rate.push(told);
    this.move(place);
  }

  private move(place: { x: number; y: number; z: number } | undefined): void {
    if (!place) return;
    const { x, y, z } = place;
    if (this.place && this.parents.size === 1) {
      const step = Math.hypot(x - this.place.x, y - this.place.y, z - this.place.z);
      if (step > JUMP_M && step > this.step * JUMP_TIMES) this.jumps++;
      else this.step = this.step * 0.9 + 0.1 * step;
    }
    this.place = { x, y, z };
  }
}

/** Every frame by its name, as /tf and /tf_static tell them. */
export class TransformTree {
  readonly frames = new Map<string, TreeFrame>();
  private isFull = false;

  /**
   * Take note of a message.
   *
   * @param now seconds by the robot's clock
   */
  take(transforms: readonly Transform[], isStatic: boolean, now: number): void {
    for (const { header, child_frame_id, transform } of transforms) {
      const child = frameName(child_frame_id);
      const parent = frameName(header?.frame_id);
      if (!child || !parent) continue;
      let frame = this.frames.get(child);
      if (frame?.isStatic !== isStatic) {
        if (!frame && this.frames.size >= MOST_FRAMES) {
          this.isFull = true;
          continue;
        }
        frame = new TreeFrame(isStatic);
        this.frames.set(child, frame);
      }
      frame.take(parent, seconds(header?.stamp), now, transform?.translation);
    }
  }

  /** Children of each frame by the parent that was told last, sorted. */
  get children(): Map<string, string[]> {
    const children = new Map<string, string[]>();
    for (const child of [...this.frames.keys()].sort()) {
      const { parent } = this.frames.get(child) as TreeFrame;
      const known = children.get(parent);
      if (known) known.push(child);
      else children.set(parent, [child]);
    }
    return children;
  }

  /** Frames without a parent, sorted. */
  get roots(): string[] {
    const parents = new Set([...this.frames.values()].map(({ parent }) => parent));
    return [...parents].filter((name) => !this.frames.has(name)).sort();
  }

  /** Loops, each once and in the order of its frames from parent to child, beginning with the first by name. */
  get loops(): string[][] {
    const done = new Set<string>();
    const loops: string[][] = [];
    for (const start of [...this.frames.keys()].sort()) {
      const way: string[] = [];
      let name = start;
      while (this.frames.has(name) && !done.has(name)) {
        done.add(name);
        way.push(name);
        name = (this.frames.get(name) as TreeFrame).parent;
      }
      const from = way.indexOf(name);
      if (from < 0) continue;
      const loop = way.slice(from).reverse();
      const first = loop.indexOf([...loop].sort()[0] as string);
      loops.push([...loop.slice(first), ...loop.slice(0, first)]);
    }
    return loops;
  }

  /** What is wrong, the worst first. */
  get faults(): TreeFault[] {
    const { roots } = this;
    const faults: TreeFault[] = this.loops.map((frames) => ({ kind: "loop", frames }));
    const each = [...this.frames].filter(([, { isStatic }]) => !isStatic);
    for (const [name, { parents }] of this.frames) {
      if (parents.size > 1)
        faults.push({ kind: "parents", frames: [name], parents: [...parents.keys()].sort() });
    }
    if (roots.length > 1) faults.push({ kind: "islands", frames: roots });
    for (const [name, frame] of each) {
      if (frame.delay > OLD_S) faults.push({ kind: "old", frames: [name], number: frame.delay });
      if (-frame.delay > FUTURE_S) faults.push({ kind: "future", frames: [name], number: -frame.delay });
      if (frame.backs) faults.push({ kind: "back", frames: [name], number: frame.backs });
      if (frame.jumps) faults.push({ kind: "jump", frames: [name], number: frame.jumps });
    }
    if (this.isFull) faults.push({ kind: "full", frames: [], number: MOST_FRAMES });
    return faults;
  }
}
