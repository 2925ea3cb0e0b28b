/** Colour maps: 256 colours each, from the least value to the greatest. */

export const PALETTES = ["turbo", "viridis", "rainbow", "grey"] as const;
export type Palette = (typeof PALETTES)[number];

type Colour = readonly [red: number, green: number, blue: number];

/** Colours at equal distances, with straight lines between them. */
const STOPS: Record<Palette, readonly Colour[]> = {
  // A. Mikhailov, 2019, without its darkest ends, which a dark page would hide.
  turbo: [
    [70, 98, 217],
    [54, 170, 249],
    [26, 228, 182],
    [114, 254, 94],
    [200, 239, 52],
    [250, 186, 57],
    [246, 107, 25],
    [203, 42, 4],
  ],
  // S. van der Walt and N. Smith, 2015.
  viridis: [
    [72, 40, 120],
    [62, 73, 137],
    [49, 104, 142],
    [38, 130, 142],
    [31, 158, 137],
    [53, 183, 121],
    [110, 206, 88],
    [181, 222, 43],
    [253, 231, 37],
  ],
  // From blue over green to red.
  rainbow: [
    [77, 13, 242],
    [13, 140, 242],
    [13, 242, 217],
    [13, 242, 64],
    [166, 242, 13],
    [242, 191, 13],
    [242, 13, 13],
  ],
  grey: [
    [40, 40, 40],
    [250, 250, 250],
  ],
};

const tables = new Map<Palette, Uint8Array>();

/** The colours of a map: red, green, blue and opacity of each. */
export function paletteColours(name: Palette): Uint8Array {
  let table = tables.get(name);
  if (!table) {
    table = new Uint8Array(256 * 4);
    const stops = STOPS[name];
    for (let at = 0; at < 256; at++) {
      const place = (at / 255) * (stops.length - 1);
      const low = Math.min(Math.floor(place), stops.length - 2);
      const [one, other] = [stops[low] as Colour, stops[low + 1] as Colour];
      const mix = (part: 0 | 1 | 2) => one[part] + (other[part] - one[part]) * (place - low);
      table.set([mix(0), mix(1), mix(2), 255], at * 4);
    }
    tables.set(name, table);
  }
  return table;
}

/** Return the palette of a name, or turbo. */
export function paletteOf(name: unknown): Palette {
  return PALETTES.find((each) => each === name) ?? "turbo";
}

/** Least and greatest of the finite values; null if there are none. */
export function rangeOf(values: ArrayLike<number>): [least: number, most: number] | null {
  let least = Number.POSITIVE_INFINITY;
  let most = Number.NEGATIVE_INFINITY;
  for (let at = 0; at < values.length; at++) {
    const value = values[at] as number;
    if (!Number.isFinite(value)) continue;
    if (value < least) least = value;
    if (value > most) most = value;
  }
  return least <= most ? [least, most] : null;
}

/** Paint points by a number of each, which is placed between two values. `colours` begins at its buffer's start. */
export function paint(
  colours: Uint8Array,
  values: ArrayLike<number>,
  palette: Palette,
  [least, most]: readonly [least: number, most: number],
): void {
  const scale = most > least ? 255 / (most - least) : 0;
  const table = new Uint32Array(paletteColours(palette).buffer);
  const pixels = new Uint32Array(colours.buffer, 0, colours.length >> 2);
  for (let at = 0; at < values.length; at++) {
    // What is no number, or infinite, is painted as the least or the greatest.
    const place = Math.round(((values[at] as number) - least) * scale);
    pixels[at] = table[Math.max(0, Math.min(255, place)) | 0] as number;
  }
}
