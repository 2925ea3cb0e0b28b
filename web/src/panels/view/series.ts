/** The last values of one line of a plot. */

/** Values that are kept at most. */
const MOST = 65_536;

export class Series {
  private readonly times = new Float64Array(MOST);
  private readonly values = new Float64Array(MOST);
  private start = 0;
  private end = 0;

  /** @param seconds that are kept */
  constructor(private readonly seconds = 60) {}

  /** Maximum number of values. */
  get length(): number {
    return this.end - this.start;
  }

  /** Add a value; times in seconds, never earlier than the one before. */
  push(time: number, value: number): void {
    if (this.end === MOST) {
      // The kept part moves to the front; when all of it is kept, the older half gives way.
      if (this.start < MOST / 2) this.start = MOST / 2;
      this.times.copyWithin(0, this.start, this.end);
      this.values.copyWithin(0, this.start, this.end);
      this.end -= this.start;
      this.start = 0;
    }
    this.times[this.end] = time;
    this.values[this.end] = value;
    this.end++;
    while (this.start < this.end && (this.times[this.start] as number) < time - this.seconds) this.start++;
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
