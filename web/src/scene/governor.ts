/** Draw quality of a moving scene: the best that keeps the frame rate. */

import type { Quality } from "./quality";

/** Draw quality of a frame. */
export interface Detail {
  /** Pixels that are drawn for each pixel of the page, along one side. */
  ratio: number;
  /** Points of a cloud at most. */
  points: number;
}

/** From the finest to the coarsest. Points come first: without a graphics card they cost most, and are missed least. */
const LEVELS: readonly Detail[] = [
  { ratio: 2, points: Number.POSITIVE_INFINITY },
  { ratio: 1.5, points: Number.POSITIVE_INFINITY },
  { ratio: 1, points: Number.POSITIVE_INFINITY },
  { ratio: 1, points: 50_000 },
  { ratio: 0.75, points: 25_000 },
  { ratio: 0.75, points: 12_000 },
  { ratio: 0.5, points: 6_000 },
  { ratio: 0.5, points: 3_000 },
];
/** Of a machine without a graphics card, which would need a second for the finest, and of one that wants little. */
const BEGIN_IN_SOFTWARE = 5;
const LOW = 6;

/** Milliseconds of a frame's mean above which the next one is coarser: 50 frames a second would not be reached. */
const TOO_LONG = 20;
/** Below this mean a finer level is tried. */
const SHORT = 10;
/** Frames that the mean is taken over before it says anything. */
const FIRST_FRAMES = 4;
/** Frames at one level before a finer one is tried; twice as many after each try that failed, to a bound. */
const PATIENCE = 40;
const MOST_PATIENCE = 40 * 32;
/** Weight of one frame in the mean. */
const WEIGHT = 0.25;

/**
 * Chooses the level of the frames to come from how long the last ones took. It goes down as soon as frames are too
 * long, and up after a while of short ones; a level that turned out to be too fine is tried ever more seldom.
 */
export class Governor {
  /** The finest that there is here: what a scene that stands still is drawn with. */
  readonly best: Detail;
  private readonly levels: readonly Detail[];
  private at: number;
  private mean = 0;
  private frames = 0;
  private patience = PATIENCE;
  private isTrying = false;

  /**
   * @param quality what is asked for; only `auto` changes with time
   * @param finest pixels of the screen for each of the page, beyond which nothing would be seen
   * @param isSoftware whether the processor draws
   */
  constructor(quality: Quality, finest: number, isSoftware: boolean) {
    const fitting = LEVELS.map((level) => ({ ...level, ratio: Math.min(level.ratio, finest) })).filter(
      ({ ratio, points }, at, all) => ratio !== all[at + 1]?.ratio || points !== all[at + 1]?.points,
    );
    const fromEnd = (level: number) => Math.max(0, fitting.length - (LEVELS.length - level));
    this.levels = quality === "low" ? fitting.slice(fromEnd(LOW), fromEnd(LOW) + 1) : fitting;
    if (quality === "high") this.levels = fitting.slice(0, 1);
    this.best = this.levels[0] as Detail;
    this.at = isSoftware && quality === "auto" ? fromEnd(BEGIN_IN_SOFTWARE) : 0;
  }

  /** Quality of the next frame of a moving scene. */
  get detail(): Detail {
    return this.levels[this.at] as Detail;
  }

  /** Count a frame that was drawn with {@link detail}, and took so many milliseconds at least. */
  drew(milliseconds: number): void {
    this.frames++;
    this.mean += (milliseconds - this.mean) * (this.frames === 1 ? 1 : WEIGHT);
    if (this.frames < FIRST_FRAMES) return;
    if (this.mean > TOO_LONG) this.coarser();
    else if (this.mean < SHORT && this.frames >= this.patience) this.finer();
  }

  private coarser(): void {
    if (this.at === this.levels.length - 1) return;
    if (this.isTrying) this.patience = Math.min(MOST_PATIENCE, this.patience * 2);
    this.go(1);
    this.isTrying = false;
  }

  private finer(): void {
    // What was tried last has held for as long as it was waited for.
    if (this.isTrying) this.patience = PATIENCE;
    if (this.at === 0) return;
    this.go(-1);
    this.isTrying = true;
  }

  private go(levels: number): void {
    this.at += levels;
    this.frames = 0;
    this.mean = 0;
  }
}
