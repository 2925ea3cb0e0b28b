/** Points: laser scans and point clouds. */

import { BufferAttribute, BufferGeometry, DynamicDrawUsage, Points, PointsMaterial } from "three";
import type { Points as DecodedPoints } from "../../decode/protocol";
import type { Message } from "../../robot/subscriptions";
import type { Detail } from "../governor";
import { frameOf, Layer, type LayerContext, within } from "./layer";

const MOST_RANGES = 200_000;

/**
 * Points whose buffers are used again from message to message, and grow when they must. Colours are drawn as they
 * are, and what is not drawn is not sent to the graphics card.
 */
class PointBuffer {
  readonly points: Points;
  private readonly material: PointsMaterial;
  private capacity = 0;
  private count = 0;
  /** Points that the graphics card has been sent, or will be. */
  private sent = 0;
  private limit = Number.POSITIVE_INFINITY;

  constructor(private readonly size: number) {
    this.material = new PointsMaterial({ size, vertexColors: true });
    this.material.onBeforeCompile = asTheyAre;
    this.points = new Points(new BufferGeometry(), this.material);
    this.points.frustumCulled = false;
    this.points.visible = false;
  }

  /** Draw so many points, which `fill` puts into the arrays: three numbers, and four octets of colour, for each. */
  set(count: number, fill: (positions: Float32Array, colours: Uint8Array) => void): void {
    const { geometry } = this.points;
    if (count > this.capacity) {
      this.capacity = Math.ceil(count * 1.25);
      geometry.dispose();
      const positions = new BufferAttribute(new Float32Array(this.capacity * 3), 3);
      geometry.setAttribute("position", positions.setUsage(DynamicDrawUsage));
      const colours = new BufferAttribute(new Uint8Array(this.capacity * 4), 4, true);
      geometry.setAttribute("color", colours.setUsage(DynamicDrawUsage));
    }
    this.count = count;
    this.points.visible = count > 0;
    if (!count) return;
    const [positions, colours] = this.attributes as [BufferAttribute, BufferAttribute];
    fill(positions.array as Float32Array, colours.array as Uint8Array);
    for (const each of this.attributes) each.clearUpdateRanges();
    this.sent = 0;
    this.draw();
  }

  /** Draw so many of the points at most, and larger where they are fewer. */
  draw(most: number = this.limit): void {
    this.limit = most;
    const drawn = Math.min(this.count, most);
    this.points.geometry.setDrawRange(0, drawn);
    // As much of the view as all of them would cover where they lie side by side, and never as much as four times.
    this.material.size = this.size * Math.min(2, Math.sqrt(this.count / Math.max(1, drawn)));
    if (drawn <= this.sent) return;
    for (const each of this.attributes) {
      each.addUpdateRange(this.sent * each.itemSize, (drawn - this.sent) * each.itemSize);
      each.needsUpdate = true;
    }
    this.sent = drawn;
  }

  private get attributes(): BufferAttribute[] {
    return Object.values(this.points.geometry.attributes) as BufferAttribute[];
  }
}

/** Metres at which the colours of ranges end. */
const FARTHEST = 8;
/** Turbo's colours (A. Mikhailov, 2019) at equal distances, and between them straight lines. */
const TURBO = [
  [48, 18, 59],
  [70, 98, 217],
  [54, 170, 249],
  [26, 228, 182],
  [114, 254, 94],
  [200, 239, 52],
  [250, 186, 57],
  [246, 107, 25],
  [203, 42, 4],
  [122, 4, 3],
] as const;

/** The colour of a share from 0 to 1, with its opacity. */
export function turbo(share: number): [number, number, number, number] {
  // The first and the last are too dark for a dark page.
  const at = 1 + Math.max(0, Math.min(1, share)) * (TURBO.length - 3);
  const low = Math.min(Math.floor(at), TURBO.length - 2);
  const [one, other] = [TURBO[low], TURBO[low + 1]];
  const mix = (part: 0 | 1 | 2) =>
    (one?.[part] ?? 0) + ((other?.[part] ?? 0) - (one?.[part] ?? 0)) * (at - low);
  return [mix(0), mix(1), mix(2), 255];
}

/** Leave out what would make a screen's colours of numbers of light: they are a screen's already. */
function asTheyAre(shader: { fragmentShader: string }): void {
  shader.fragmentShader = shader.fragmentShader.replace("#include <colorspace_fragment>", "");
}

/** sensor_msgs/LaserScan. */
export class ScanLayer extends Layer {
  private readonly buffer = new PointBuffer(0.06);

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
    const most = Math.min(Number(range_max), FARTHEST) || FARTHEST;
    this.buffer.set(found.length, (positions, colours) => {
      found.forEach((at, index) => {
        const angle = Number(angle_min) + at * Number(angle_increment);
        const range = ranges[at] as number;
        positions[index * 3] = range * Math.cos(angle);
        positions[index * 3 + 1] = range * Math.sin(angle);
        positions[index * 3 + 2] = 0;
        colours.set(turbo(range / most), index * 4);
      });
    });
  }
}

/** sensor_msgs/PointCloud2, decoded by the worker. */
export class CloudLayer extends Layer {
  private readonly buffer = new PointBuffer(0.025);

  constructor(context: LayerContext) {
    super(context);
    this.group.add(this.buffer.points);
    this.hear((message) => this.take(message), { throttle: 100, decoding: "cloud" });
  }

  override prepare({ points }: Detail): void {
    this.buffer.draw(points);
  }

  private take(message: Message): void {
    if (typeof message.$error === "string") throw new Error(message.$error);
    const decoded = message.$points as DecodedPoints | undefined;
    if (!decoded) return;
    this.moveTo(frameOf(message));
    this.buffer.set(decoded.count, (positions, colours) => {
      positions.set(decoded.positions);
      colours.set(decoded.colors);
    });
  }
}
