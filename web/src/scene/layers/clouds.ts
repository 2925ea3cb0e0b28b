/** Points: laser scans and point clouds. */

import { BufferAttribute, BufferGeometry, Color, DynamicDrawUsage, Points, PointsMaterial } from "three";
import type { Points as DecodedPoints } from "../../decode/protocol";
import type { Message } from "../../robot/subscriptions";
import { frameOf, Layer, type LayerContext, within } from "./layer";

const MOST_RANGES = 200_000;

/** Points whose buffers are used again from message to message, and grow when they must. */
class PointBuffer {
  readonly points: Points;
  private capacity = 0;

  constructor(size: number, colour: number | null) {
    this.points = new Points(
      new BufferGeometry(),
      new PointsMaterial({
        size,
        sizeAttenuation: true,
        vertexColors: colour === null,
        color: colour ?? 0xffffff,
      }),
    );
    this.points.frustumCulled = false;
  }

  /** Draw so many points, which `fill` puts into the arrays. */
  set(count: number, fill: (positions: Float32Array, colours: Uint8Array) => void): void {
    const { geometry } = this.points;
    if (count > this.capacity) {
      this.capacity = Math.ceil(count * 1.25);
      geometry.dispose();
      const positions = new BufferAttribute(new Float32Array(this.capacity * 3), 3);
      const colours = new BufferAttribute(new Uint8Array(this.capacity * 3), 3, true);
      geometry.setAttribute("position", positions.setUsage(DynamicDrawUsage));
      geometry.setAttribute("color", colours.setUsage(DynamicDrawUsage));
    }
    geometry.setDrawRange(0, count);
    if (!count) return;
    const positions = geometry.getAttribute("position") as BufferAttribute;
    const colours = geometry.getAttribute("color") as BufferAttribute;
    fill(positions.array as Float32Array, colours.array as Uint8Array);
    for (const each of [positions, colours]) {
      each.clearUpdateRanges();
      each.addUpdateRange(0, count * 3);
      each.needsUpdate = true;
    }
  }
}

/** sensor_msgs/LaserScan. */
export class ScanLayer extends Layer {
  private readonly buffer = new PointBuffer(0.06, 0xe0218a);

  constructor(context: LayerContext) {
    super(context);
    this.group.add(this.buffer.points);
    this.hear((message) => this.take(message), { throttle: 50 });
  }

  private take(message: Message): void {
    const ranges = message.ranges as ArrayLike<number | null>;
    within("the number of ranges", ranges.length, 0, MOST_RANGES);
    const { angle_min, angle_increment, range_min, range_max } = message as Record<string, number>;
    this.moveTo(frameOf(message));
    const found: number[] = [];
    for (let at = 0; at < ranges.length; at++) {
      const range = ranges[at];
      // What is beyond the scanner's own bounds, infinite or no number is no echo.
      if (
        typeof range === "number" &&
        Number.isFinite(range) &&
        range >= Number(range_min) &&
        range <= Number(range_max)
      )
        found.push(at);
    }
    this.buffer.set(found.length, (positions) => {
      found.forEach((at, index) => {
        const angle = Number(angle_min) + at * Number(angle_increment);
        const range = ranges[at] as number;
        positions[index * 3] = range * Math.cos(angle);
        positions[index * 3 + 1] = range * Math.sin(angle);
        positions[index * 3 + 2] = 0;
      });
    });
  }
}

/** sensor_msgs/PointCloud2, decoded by the worker; without colours of its own it is coloured by height. */
export class CloudLayer extends Layer {
  private readonly buffer = new PointBuffer(0.025, null);

  constructor(context: LayerContext) {
    super(context);
    this.group.add(this.buffer.points);
    this.hear((message) => this.take(message), { throttle: 100, decoding: "cloud" });
  }

  private take(message: Message): void {
    if (typeof message.$error === "string") throw new Error(message.$error);
    const decoded = message.$points as DecodedPoints | undefined;
    if (!decoded) return;
    this.moveTo(frameOf(message));
    this.buffer.set(decoded.count, (positions, colours) => {
      positions.set(decoded.positions);
      if (decoded.colors) colours.set(decoded.colors);
      else paint(colours, decoded);
    });
  }
}

/** Red, green and blue of 256 colours from blue to red. */
const palette = Uint8Array.from(
  Array.from({ length: 256 }, (_, at) => {
    const { r, g, b } = new Color().setHSL(0.7 * (1 - at / 255), 0.9, 0.5);
    return [r * 255, g * 255, b * 255];
  }).flat(),
);

/** Colour points by their intensity, or else by their height. */
function paint(colours: Uint8Array, { count, positions, intensities }: DecodedPoints): void {
  let least = Number.POSITIVE_INFINITY;
  let most = Number.NEGATIVE_INFINITY;
  const value = (at: number) => (intensities ? intensities[at] : positions[at * 3 + 2]) as number;
  for (let at = 0; at < count; at++) {
    const each = value(at);
    if (each < least) least = each;
    if (each > most) most = each;
  }
  const scale = most > least ? 255 / (most - least) : 0;
  for (let at = 0; at < count; at++) {
    // Octet by octet: a hundred thousand small arrays would cost more than all the rest.
    const from = Math.round((value(at) - least) * scale) * 3;
    colours[at * 3] = palette[from] as number;
    colours[at * 3 + 1] = palette[from + 1] as number;
    colours[at * 3 + 2] = palette[from + 2] as number;
  }
}
