/** sensor_msgs/PointCloud2 → arrays as a renderer takes them. */

import { bytesOf } from "./bytes";
import type { Points } from "./protocol";

/** Points of one cloud that are drawn; of larger ones it is a sample. */
export const MOST_POINTS = 500_000;
/** Clouds of so many points keep their order: the coarsest view draws them whole. */
const FEW_POINTS = 2_000;
/** The golden ratio's share: steps of it through a circle spread evenly, wherever they end. */
const GOLDEN = (Math.sqrt(5) - 1) / 2;

export interface PointField {
  name: string;
  offset: number;
  datatype: number;
}

export interface PointCloud2 {
  width: number;
  height: number;
  fields: PointField[];
  is_bigendian: boolean;
  point_step: number;
  row_step: number;
  data: unknown;
}

type Read = (view: DataView, at: number, little: boolean) => number;

/** By the constants of sensor_msgs/PointField. */
const READ: Record<number, Read> = {
  1: (view, at) => view.getInt8(at),
  2: (view, at) => view.getUint8(at),
  3: (view, at, little) => view.getInt16(at, little),
  4: (view, at, little) => view.getUint16(at, little),
  5: (view, at, little) => view.getInt32(at, little),
  6: (view, at, little) => view.getUint32(at, little),
  7: (view, at, little) => view.getFloat32(at, little),
  8: (view, at, little) => view.getFloat64(at, little),
};
const SIZE: Record<number, number> = { 1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8 };

/**
 * The points of a cloud but for those without a finite place. Throws where fields and data do not fit.
 *
 * A cloud without colours of its own is coloured by its field `intensity`, or else by height, from blue to red.
 */
export function decodeCloud(cloud: PointCloud2): Points {
  const data = bytesOf(cloud.data);
  const step = cloud.point_step;
  const total = Math.min(cloud.width * cloud.height, step > 0 ? Math.floor(data.length / step) : 0);
  const field = (name: string) => {
    const found = cloud.fields.find((each) => each.name === name);
    if (!found) return undefined;
    const size = SIZE[found.datatype];
    if (!size || found.offset + size > step) {
      throw new Error(`field ${name} does not fit into a point of ${step} bytes`);
    }
    return { at: found.offset, read: READ[found.datatype] as Read };
  };
  const [x, y, z] = [field("x"), field("y"), field("z")];
  if (!x || !y) throw new Error("the cloud has no fields x and y");
  const color = field("rgb") ?? field("rgba");
  const shade = field("intensity");
  const most = Math.min(total, MOST_POINTS);
  const positions = new Float32Array(most * 3);
  const colors = new Uint8Array(most * 4).fill(255);
  const shades = color ? null : new Float32Array(most);
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  const little = !cloud.is_bigendian;
  const stride = strideThrough(total);
  let count = 0;
  for (let taken = 0, next = 0; taken < most; taken++) {
    const index = next;
    next += stride;
    if (next >= total) next -= total;
    // Rows may be padded.
    const row = cloud.width > 0 ? Math.floor(index / cloud.width) : 0;
    const start = cloud.row_step ? row * cloud.row_step + (index - row * cloud.width) * step : index * step;
    if (start + step > data.length) continue;
    const px = x.read(view, start + x.at, little);
    const py = y.read(view, start + y.at, little);
    const pz = z ? z.read(view, start + z.at, little) : 0;
    if (!Number.isFinite(px + py + pz)) continue;
    positions[count * 3] = px;
    positions[count * 3 + 1] = py;
    positions[count * 3 + 2] = pz;
    if (color) {
      // Packed in 32 bits, also where the field calls itself a float.
      const packed = view.getUint32(start + color.at, little);
      colors[count * 4] = (packed >> 16) & 255;
      colors[count * 4 + 1] = (packed >> 8) & 255;
      colors[count * 4 + 2] = packed & 255;
    }
    if (shades) shades[count] = shade ? shade.read(view, start + shade.at, little) : pz;
    count++;
  }
  if (shades) paint(colors, shades.subarray(0, count));
  return { count, positions: positions.subarray(0, count * 3), colors: colors.subarray(0, count * 4) };
}

/** Step between visited points, so that each is visited once and every prefix is spread over the whole cloud. */
function strideThrough(total: number): number {
  if (total <= FEW_POINTS) return 1;
  let stride = Math.round(total * GOLDEN);
  while (divisor(stride, total) !== 1) stride++;
  return stride;
}

function divisor(one: number, other: number): number {
  return other === 0 ? one : divisor(other, one % other);
}

/** 256 colours from blue over green to red, four octets each. */
const PALETTE = new Uint8Array(256 * 4);
for (let at = 0; at < 256; at++) {
  const hue = 4.2 * (1 - at / 255);
  // The hue's hexagon, at half lightness and nine tenths of saturation.
  const part = (away: number) => 127.5 + 127.5 * 0.9 * Math.max(-1, Math.min(1, away));
  PALETTE.set(
    [part(Math.abs(hue - 3) * 2 - 3), part(3 - Math.abs(hue - 2) * 2), part(3 - Math.abs(hue - 4) * 2), 255],
    at * 4,
  );
}

/** Colour points by a number of each, between the least and the greatest that there is. */
function paint(colors: Uint8Array, shades: Float32Array): void {
  let least = Number.POSITIVE_INFINITY;
  let most = Number.NEGATIVE_INFINITY;
  for (const shade of shades) {
    if (!Number.isFinite(shade)) continue;
    if (shade < least) least = shade;
    if (shade > most) most = shade;
  }
  const scale = most > least ? 255 / (most - least) : 0;
  const palette = new Uint32Array(PALETTE.buffer);
  const pixels = new Uint32Array(colors.buffer);
  for (let at = 0; at < shades.length; at++) {
    // What is no number, or infinite, is painted as the least or the greatest.
    const place = Math.round(((shades[at] as number) - least) * scale);
    pixels[at] = palette[Math.max(0, Math.min(255, place)) | 0] as number;
  }
}
