/** The delay of a stream's images, by their stamps. */

/** Drift of the clocks that is allowed for, in seconds per second. */
const DRIFT = 1e-4;
/** Seconds by which a stamp may be ahead of the robot's clock before it counts as one of another clock. */
const AHEAD = 0.5;
/** Seconds by which a stamp may be before the last one, where several cameras share a topic. */
const BACK = 1;

/**
 * Delay of each image of one stream. Two estimates are made, and the smaller one counts, so that an image is shown as
 * old only if both say so:
 *
 * - against the fastest image so far, which holds for any clock that runs at the usual speed;
 * - against the robot's clock, which holds at any speed of a simulation, if the stamps are of that clock.
 */
export class Delay {
  private least = Number.POSITIVE_INFINITY;
  private last = Number.NEGATIVE_INFINITY;
  private at = 0;

  /**
   * The delay of an image in seconds; 0 without a stamp.
   *
   * @param stamp seconds by the clock of the images
   * @param now seconds of a clock that never steps
   * @param robot seconds by the robot's clock; NaN if the stamps are not of it
   */
  of(stamp: number, now: number, robot: number): number {
    if (!Number.isFinite(stamp)) return 0;
    // The clock of the images was set back, or a recording began anew.
    if (stamp < this.last - BACK) this.least = Number.POSITIVE_INFINITY;
    this.last = stamp;
    this.least = Math.min(now - stamp, this.least + (now - this.at) * DRIFT);
    this.at = now;
    const delay = now - stamp - this.least;
    const absolute = robot - stamp;
    return absolute >= -AHEAD ? Math.min(delay, Math.max(0, absolute)) : delay;
  }
}
