/** Share of a cloud's points that the server is asked for, so that no more arrive than are drawn. */

/** Points of a cloud that are drawn where the processor does, and where a graphics card does. */
const IN_SOFTWARE = 50_000;
const BY_CARD = 500_000;
/** Every so many points at most. */
const MOST = 4096;
/** Clouds after a change that may still be as they were before it. */
const ON_THE_WAY = 5;

/** Chooses which share it is from the clouds that arrive. */
export class Thinning {
  /** Every so many points are wanted; of organised clouds so many rows and columns. */
  stride = 1;
  /** Points of which one is wanted. */
  oneOf = 1;
  private readonly most: number;
  private onTheWay = 0;

  /** @param isSoftware whether the processor draws */
  constructor(isSoftware: boolean) {
    this.most = isSoftware ? IN_SOFTWARE : BY_CARD;
  }

  /**
   * Count a cloud that arrived with so many points, in one row or in several.
   * It becomes finer only where half as many points would do, so that it does not change to and fro.
   */
  heard(points: number, isOrganised: boolean): void {
    if (this.onTheWay > 0) {
      this.onTheWay--;
      return;
    }
    const share = (stride: number) => (isOrganised ? stride * stride : stride);
    const whole = points * share(this.stride);
    const fits = (stride: number, most: number) => whole / share(stride) <= most;
    let { stride } = this;
    while (!fits(stride, this.most) && share(stride * 2) <= MOST) stride *= 2;
    while (stride > 1 && fits(stride / 2, this.most / 2)) stride /= 2;
    if (stride === this.stride) return;
    this.stride = stride;
    this.oneOf = share(stride);
    this.onTheWay = ON_THE_WAY;
  }

  /** Clouds come whole, whatever is wanted. */
  reset(): void {
    this.stride = this.oneOf = 1;
  }
}
