/** sensor_msgs/PointCloud2 → arrays as a renderer takes them. */

import { bytesOf } from "./bytes";
import { type Palette, paint, rangeOf } from "./palette";
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
 * A cloud without colours of its own is coloured by its field `intensity`, or else by height.
 *
 * @param by field that colours it, even if it has colours of its own; empty for the usual one
 */
export function decodeCloud(cloud: PointCloud2, by = "", palette: Palette = "turbo"): Points {
  const data = bytesOf(cloud.data);
  const step = cloud.point_step;
  // A part of a point would make the search for a stride endless.
  if (![cloud.width, cloud.height, step].every((each) => Number.isSafeInteger(each) && each >= 0)) {
    throw new Error(`a cloud of ${cloud.width} × ${cloud.height} points of ${step} bytes`);
  }
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
  const shown = [by, "rgb", "rgba", "intensity", "z"].find((name) => name && field(name)) ?? "";
  const color = shown.startsWith("rgb") ? field(shown) : undefined;
  const shade = field(shown);
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
  const range = shades && rangeOf(shades.subarray(0, count));
  if (shades && range) paint(colors, shades.subarray(0, count), palette, range);
  return {
    count,
    positions: positions.subarray(0, count * 3),
    colors: colors.subarray(0, count * 4),
    fields: cloud.fields.map(({ name }) => name),
    by: shown,
    range,
  };
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
