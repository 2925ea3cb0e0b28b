/** sensor_msgs/Image → the pixels of a canvas. */

import { bytesOf } from "./bytes";
import type { Pixels } from "./protocol";

const MOST_PIXELS = 16_000_000;

export interface RawImage {
  width: number;
  height: number;
  encoding: string;
  is_bigendian: number | boolean;
  step: number;
  data: unknown;
}

/** Red, green and blue by their places in a pixel of so many octets. */
const COLOURS: Record<string, [octets: number, red: number, green: number, blue: number]> = {
  rgb8: [3, 0, 1, 2],
  bgr8: [3, 2, 1, 0],
  rgba8: [4, 0, 1, 2],
  bgra8: [4, 2, 1, 0],
  "8UC3": [3, 2, 1, 0],
  "8UC4": [4, 2, 1, 0],
  mono8: [1, 0, 0, 0],
  "8UC1": [1, 0, 0, 0],
};
const DEPTHS: Record<string, "u16" | "f32"> = { mono16: "u16", "16UC1": "u16", "32FC1": "f32" };

/** Depth images are stretched over their own range. Throws for encodings that are not known. */
export function decodeImage(image: RawImage): Pixels {
  const { width, height, encoding } = image;
  const isWhole = Number.isSafeInteger(width) && Number.isSafeInteger(height);
  if (!(isWhole && width > 0 && height > 0 && width * height <= MOST_PIXELS)) {
    throw new Error(`an image of ${width} × ${height} pixels`);
  }
  const data = bytesOf(image.data);
  const rgba = new Uint8ClampedArray(width * height * 4).fill(255);
  const colour = COLOURS[encoding];
  const depth = DEPTHS[encoding];
  const octets = colour ? colour[0] : depth === "u16" ? 2 : 4;
  if (!colour && !depth) throw new Error(`the encoding ${encoding} cannot be shown`);
  const step = image.step || width * octets;
  if (step < width * octets || data.length < step * (height - 1) + width * octets) {
    throw new Error(`${data.length} octets are too few for ${width} × ${height} pixels of ${encoding}`);
  }
  if (colour) {
    const [, red, green, blue] = colour;
    for (let row = 0, to = 0; row < height; row++) {
      for (let from = row * step, column = 0; column < width; column++, from += octets, to += 4) {
        rgba[to] = data[from + red] as number;
        rgba[to + 1] = data[from + green] as number;
        rgba[to + 2] = data[from + blue] as number;
      }
    }
    return { width, height, rgba };
  }
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  const little = !image.is_bigendian;
  const values = new Float32Array(width * height);
  let least = Number.POSITIVE_INFINITY;
  let most = Number.NEGATIVE_INFINITY;
  for (let row = 0, to = 0; row < height; row++) {
    for (let column = 0; column < width; column++, to++) {
      const at = row * step + column * octets;
      const value = depth === "u16" ? view.getUint16(at, little) : view.getFloat32(at, little);
      values[to] = value;
      if (Number.isFinite(value) && value !== 0) {
        least = Math.min(least, value);
        most = Math.max(most, value);
      }
    }
  }
  const scale = most > least ? 255 / (most - least) : 0;
  for (let index = 0; index < values.length; index++) {
    const value = values[index] as number;
    const grey = Number.isFinite(value) && value !== 0 ? 255 - (value - least) * scale * 0.8 : 0;
    rgba.fill(grey, index * 4, index * 4 + 3);
  }
  return { width, height, rgba };
}
