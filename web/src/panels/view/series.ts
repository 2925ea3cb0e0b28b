/** The last values of one line of a plot. */

/** Values that are kept at most, and values in one block, whose extent is known. */
const MOST = 1 << 20;
const BLOCK = 64;
const FIRST = 4096;

/** Least and greatest value; infinite if there is none. */
export type Extent = [least: number, most: number];

/** What a table says of the values in a span of time. */
export interface Statistics {
  count: number;
  least: number;
  most: number;
  mean: number;
  /** Standard deviation. */
  deviation: number;
}

/**
 * Values in order of time. Drawing costs as much as the picture is wide, however many values there are: the extent
 * of each block of values is known.
 */
export class Series {
  private times = new Float64Array(FIRST);
  private values = new Float64Array(FIRST);
  /** Least and greatest value of each block, one after the other. */
  private extents = new Float64Array((2 * FIRST) / BLOCK);
  private start = 0;
  private end = 0;

  /**
   * @param seconds that are kept
   * @param most values that are kept at most; a power of two
   */
  constructor(
    private seconds = 60,
    private readonly most = MOST,
  ) {}

  /** Maximum number of values. */
  get length(): number {
    return this.end - this.start;
  }

  /** Time of the first value and of the last one; null without values. */
  get span(): [from: number, until: number] | null {
    if (!this.length) return null;
    return [this.times[this.start] as number, this.times[this.end - 1] as number];
  }

  /** Change how many seconds are kept, from the next value on. */
  keep(seconds: number): void {
    this.seconds = seconds;
  }

  clear(): void {
    this.start = this.end = 0;
  }

  /** Add a value; times in seconds. A time before the last one, as after a jump back in a recording, begins anew. */
  push(time: number, value: number): void {
    if (this.length && time < (this.times[this.end - 1] as number)) this.clear();
    if (this.end === this.times.length) this.makeRoom();
    const at = this.end++;
    this.times[at] = time;
    this.values[at] = value;
    const block = 2 * Math.floor(at / BLOCK);
    if (at % BLOCK === 0) {
      this.extents[block] = Number.POSITIVE_INFINITY;
      this.extents[block + 1] = Number.NEGATIVE_INFINITY;
    }
    if (Number.isFinite(value)) {
      this.extents[block] = Math.min(this.extents[block] as number, value);
      this.extents[block + 1] = Math.max(this.extents[block + 1] as number, value);
    }
    while (this.start < this.end && (this.times[this.start] as number) < time - this.seconds) this.start++;
  }

  private makeRoom(): void {
    // The kept part moves to the front, whole blocks at a time; when all of it is kept, there is more room, or the
    // older half is dropped.
    if (this.start < this.end / 2) {
      if (this.end < this.most) {
        const grown = (old: Float64Array) => {
          const all = new Float64Array(old.length * 2);
          all.set(old);
          return all;
        };
        [this.times, this.values, this.extents] = [
          grown(this.times),
          grown(this.values),
          grown(this.extents),
        ];
        return;
      }
      this.start = this.most / 2;
    }
    const from = Math.floor(this.start / BLOCK) * BLOCK;
    this.times.copyWithin(0, from, this.end);
    this.values.copyWithin(0, from, this.end);
    this.extents.copyWithin(0, (2 * from) / BLOCK, 2 * Math.ceil(this.end / BLOCK));
    this.start -= from;
    this.end -= from;
  }

  /** Place of the first value at a time or later. */
  private placeOf(time: number): number {
    let low = this.start;
    let high = this.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if ((this.times[middle] as number) < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** Value at a time: the last one until then; NaN before the first. */
  at(time: number): number {
    const place = this.placeOf(time);
    const exact = place < this.end && this.times[place] === time;
    const at = exact ? place : place - 1;
    return at < this.start ? Number.NaN : (this.values[at] as number);
  }

  /** The last value; NaN without one. */
  get last(): number {
    return this.length ? (this.values[this.end - 1] as number) : Number.NaN;
  }

  private extentOf(from: number, until: number): Extent {
    let least = Number.POSITIVE_INFINITY;
    let most = Number.NEGATIVE_INFINITY;
    for (let at = from; at < until; ) {
      if (at % BLOCK === 0 && at + BLOCK <= until) {
        const block = (2 * at) / BLOCK;
        least = Math.min(least, this.extents[block] as number);
        most = Math.max(most, this.extents[block + 1] as number);
        at += BLOCK;
        continue;
      }
      const value = this.values[at++] as number;
      if (!Number.isFinite(value)) continue;
      if (value < least) least = value;
      if (value > most) most = value;
    }
    return [least, most];
  }

  /** Extent of the values between two times. */
  extent(from = Number.NEGATIVE_INFINITY, until = Number.POSITIVE_INFINITY): Extent {
    return this.extentOf(this.placeOf(from), this.placeOf(until));
  }

  /** Draw the values between two times as a line, of at most about three points for each column of the picture. */
  draw(from: number, until: number, columns: number, point: (time: number, value: number) => void): void {
    // One value on either side, so that the line goes on to the edges.
    const first = Math.max(this.start, this.placeOf(from) - 1);
    const last = Math.min(this.end, this.placeOf(until) + 1);
    if (last - first <= 4 * columns) {
      for (let at = first; at < last; at++) point(this.times[at] as number, this.values[at] as number);
      return;
    }
    const width = (until - from) / columns;
    for (let column = 0, at = first; column < columns && at < last; column++) {
      const end = column === columns - 1 ? last : Math.min(last, this.placeOf(from + (column + 1) * width));
      if (end <= at) continue;
      const time = from + (column + 0.5) * width;
      const [least, most] = this.extentOf(at, end);
      if (least > most) point(time, Number.NaN);
      else {
        point(time, this.values[at] as number);
        point(time, least);
        point(time, most);
        point(time, this.values[end - 1] as number);
      }
      at = end;
    }
  }

  /** Statistics of the values between two times. */
  statistics(from: number, until: number): Statistics {
    const end = this.placeOf(until);
    let count = 0;
    let mean = 0;
    let squares = 0;
    const first = this.placeOf(from);
    for (let at = first; at < end; at++) {
      const value = this.values[at] as number;
      if (!Number.isFinite(value)) continue;
      const difference = value - mean;
      mean += difference / ++count;
      squares += difference * (value - mean);
    }
    const [least, most] = this.extentOf(first, end);
    return { count, least, most, mean: count ? mean : Number.NaN, deviation: Math.sqrt(squares / count) };
  }

  /** Draw this series against another one: each value of it, and the other's at the same time. */
  drawAgainst(
    other: Series,
    from: number,
    until: number,
    most: number,
    point: (x: number, y: number) => void,
  ): void {
    const end = this.placeOf(until);
    const first = Math.max(this.placeOf(from), end - most);
    for (let at = first; at < end; at++) point(other.at(this.times[at] as number), this.values[at] as number);
  }

  /** Times of all series in order, and the values of each at them: null where one has none, or no number. */
  static together(all: Series[]): (number | null)[][] {
    const at = all.map(({ start }) => start);
    const rows: (number | null)[][] = [[], ...all.map(() => [] as (number | null)[])];
    for (;;) {
      let time = Number.POSITIVE_INFINITY;
      all.forEach((series, index) => {
        if ((at[index] as number) < series.end)
          time = Math.min(time, series.times[at[index] as number] as number);
      });
      if (time === Number.POSITIVE_INFINITY) return rows;
      (rows[0] as number[]).push(time);
      all.forEach((series, index) => {
        const here = at[index] as number;
        const isHere = here < series.end && series.times[here] === time;
        const value = isHere ? (series.values[here] as number) : Number.NaN;
        (rows[index + 1] as (number | null)[]).push(Number.isFinite(value) ? value : null);
        if (isHere) at[index] = here + 1;
      });
    }
  }
}
