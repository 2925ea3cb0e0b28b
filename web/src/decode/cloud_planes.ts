/** point_cloud_interfaces/CompressedPointCloud2 in the format `rwt_planes` → the octets of the points. See docs/reference/point-clouds.md. */

import { decompress } from "fzstd";
import { bytesOf } from "./bytes";
import type { PointCloud2 } from "./cloud";

export interface CompressedCloud extends Omit<PointCloud2, "data"> {
  fields: { name: string; offset: number; datatype: number; count?: number }[];
  compressed_data: unknown;
  format: string;
}

const HEAD = 16;
const COLUMN = 10;
const MOST_COLUMNS = 256;
/** Bytes of a decompressed cloud. */
const MOST_BYTES = 64 << 20;
/** Mode of quantised numbers some of which are missing. */
const GAPS = 2;
/** Octets of a number, by the constants of sensor_msgs/PointField. */
const SIZE: Record<number, number> = { 1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8 };
const [FLOAT32, FLOAT64] = [7, 8];

interface Column {
  at: number;
  datatype: number;
  mode: number;
  planes: number;
  step: number;
}

/** Return the octets of the points. Throws where the data does not fit the message, before anything is allocated. */
export function decompressCloud(cloud: CompressedCloud): Uint8Array {
  const data = bytesOf(cloud.compressed_data);
  const points = cloud.width * cloud.height;
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  const { columns, lag } = readHead(cloud, view, points);
  const gaps = (points + 7) >> 3;
  const size = columns.reduce(
    (sum, { mode, planes }) => sum + planes * points + (mode === GAPS ? gaps : 0),
    0,
  );
  const body = data.subarray(HEAD + COLUMN * columns.length);
  if (contentSize(body) !== size) throw new Error(`the compressed planes do not declare ${size} bytes`);
  const planes = size ? decompress(body, new Uint8Array(size)) : body.subarray(0, 0);
  if (planes.length !== size) throw new Error("the compressed planes are damaged");
  const found = new Uint8Array(points * cloud.point_step);
  let at = 0;
  for (const column of columns) {
    const end = at + (column.mode === GAPS ? gaps : 0) + column.planes * points;
    write(column, planes.subarray(at, end), points, lag, found, cloud.point_step);
    at = end;
  }
  return found;
}

function readHead(cloud: CompressedCloud, view: DataView, points: number) {
  const step = cloud.point_step;
  const places = cloud.fields.flatMap(({ offset, datatype, count }) => {
    const size = SIZE[datatype] ?? 0;
    const many = Math.max(1, count ?? 1);
    if (!size || offset + size * many > step || many > MOST_COLUMNS)
      throw new Error("a field does not fit into a point");
    return Array.from({ length: many }, (_, each) => ({ at: offset + each * size, datatype }));
  });
  const bytes =
    points *
    Math.max(
      step,
      places.reduce((sum, { datatype }) => sum + (SIZE[datatype] as number), 0),
    );
  if (!Number.isSafeInteger(bytes) || bytes > MOST_BYTES || places.length > MOST_COLUMNS)
    throw new Error(`a cloud of ${bytes} bytes and ${places.length} columns`);
  if (view.byteLength < HEAD + COLUMN * places.length) throw new Error("too few bytes for a header");
  const lag = view.getUint32(12, true);
  const fits =
    view.getUint32(0) === 0x52575043 &&
    view.getUint8(4) === 1 &&
    view.getUint8(5) <= 1 &&
    view.getUint16(6, true) === places.length &&
    view.getUint32(8, true) === points;
  if (cloud.is_bigendian || !fits || lag < 1 || lag > Math.max(points, 1))
    throw new Error("the compressed data does not fit the cloud");
  const columns = places.map((place, number): Column => {
    const at = HEAD + COLUMN * number;
    const [mode, planes, step] = [view.getUint8(at), view.getUint8(at + 1), view.getFloat64(at + 2, true)];
    const isFloat = place.datatype === FLOAT32 || place.datatype === FLOAT64;
    if (mode > (isFloat ? GAPS : 0) || planes > (mode ? 4 : (SIZE[place.datatype] as number)))
      throw new Error(`a column of mode ${mode} with ${planes} planes`);
    return { ...place, mode, planes, step };
  });
  return { columns, lag };
}

/** The size that a zstd frame declares for its content (RFC 8878, section 3.1.1.1); -1 for none. */
function contentSize(frame: Uint8Array): number {
  const view = new DataView(frame.buffer, frame.byteOffset, frame.byteLength);
  if (frame.length < 6 || view.getUint32(0, true) !== 0xfd2fb528) return -1;
  const descriptor = view.getUint8(4);
  const [flag, isSingle] = [descriptor >> 6, (descriptor >> 5) & 1];
  const at = 6 - isSingle;
  const width = flag ? 1 << flag : isSingle;
  if (descriptor & 0b1011 || !width || frame.length < at + width) return -1;
  if (width === 1) return view.getUint8(at);
  if (width === 2) return view.getUint16(at, true) + 256;
  return view.getUint32(at, true) + (width === 8 ? view.getUint32(at + 4, true) * 2 ** 32 : 0);
}

/** Undo the differences of one column, and write its numbers into the points. */
function write(
  { at, datatype, mode, planes, step }: Column,
  octets: Uint8Array,
  points: number,
  lag: number,
  found: Uint8Array,
  pointStep: number,
): void {
  const first = mode === GAPS ? (points + 7) >> 3 : 0;
  const isWide = !mode && SIZE[datatype] === 8;
  const view = new DataView(found.buffer);
  const low = new Int32Array(points);
  const high = isWide ? new Int32Array(points) : low;
  const word = (index: number, from: number) => {
    let folded = 0;
    for (let plane = from; plane < Math.min(planes, from + 4); plane++)
      folded |= (octets[first + plane * points + index] as number) << (8 * (plane - from));
    return folded;
  };
  for (let index = 0, to = at; index < points; index++, to += pointStep) {
    const folded = word(index, 0);
    const sign = -(folded & 1);
    if (isWide) {
      const upper = word(index, 4);
      const sum = (((folded >>> 1) | (upper << 31)) ^ sign) >>> 0;
      const total = sum + ((index < lag ? 0 : (low[index - lag] as number)) >>> 0);
      low[index] = total;
      high[index] =
        ((upper >>> 1) ^ sign) +
        (index < lag ? 0 : (high[index - lag] as number)) +
        (total > 0xffffffff ? 1 : 0);
      view.setInt32(to, low[index] as number, true);
      view.setInt32(to + 4, high[index] as number, true);
      continue;
    }
    const number = (((folded >>> 1) ^ sign) + (index < lag ? 0 : (low[index - lag] as number))) | 0;
    low[index] = number;
    if (mode) {
      const isGap = mode === GAPS && !(((octets[index >> 3] as number) >> (index & 7)) & 1);
      const value = isGap ? Number.NaN : number * step;
      if (datatype === FLOAT32) view.setFloat32(to, value, true);
      else view.setFloat64(to, value, true);
    } else if (SIZE[datatype] === 1) view.setInt8(to, number);
    else if (SIZE[datatype] === 2) view.setInt16(to, number, true);
    else view.setInt32(to, number, true);
  }
}
