/** Points: laser scans and point clouds. */

import {
  BufferAttribute,
  BufferGeometry,
  DynamicDrawUsage,
  type Intersection,
  type Object3D,
  Points,
  PointsMaterial,
} from "three";
import { PALETTES, paint, paletteOf, rangeOf } from "../../decode/palette";
import type { Points as DecodedPoints } from "../../decode/protocol";
import { fixed } from "../../i18n/formats";
import type { TextKey } from "../../i18n/text";
import type { Message } from "../../robot/subscriptions";
import type { Detail } from "../governor";
import { Thinning } from "../thinning";
import { METRE_OF_POINTS } from "../view";
import { frameOf, Layer, type LayerContext, type LayerOption, within } from "./layer";

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

  /** @param size diameter of a point in the library's own measure */
  constructor(private size: number) {
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

  resize(size: number): void {
    this.size = size;
    this.draw();
  }

  dispose(): void {
    this.points.geometry.dispose();
    this.material.dispose();
    this.points.removeFromParent();
  }

  private get attributes(): BufferAttribute[] {
    return Object.values(this.points.geometry.attributes) as BufferAttribute[];
  }
}

/** Leave out what would make a screen's colours of numbers of light: they are a screen's already. */
function asTheyAre(shader: { fragmentShader: string }): void {
  shader.fragmentShader = shader.fragmentShader.replace("#include <colorspace_fragment>", "");
}

/** Clouds that are kept at a time, however long they stay. */
const MOST_KEPT = 100;
/** Centimetres of the library's own measure of points. */
const CENTIMETRE = 0.01 * METRE_OF_POINTS;

/** Points that may stay for a while where they were. */
abstract class PointsLayer extends Layer {
  private readonly buffers: { buffer: PointBuffer; at: number }[] = [];
  private timer: ReturnType<typeof setTimeout> | undefined;
  private most = Number.POSITIVE_INFINITY;

  constructor(context: LayerContext) {
    super(context);
    this.until(() => {
      clearTimeout(this.timer);
      for (const { buffer } of this.buffers) buffer.dispose();
    });
  }

  override get objects(): readonly Object3D[] {
    return this.buffers.map(({ buffer }) => buffer.points);
  }

  override prepare({ points }: Detail): void {
    this.most = points;
    for (const { buffer } of this.buffers) buffer.draw(points / this.buffers.length);
  }

  protected override configured(): void {
    for (const { buffer } of this.buffers) buffer.resize(this.size);
    this.forget();
  }

  /** Draw points of a frame; those before them stay where they are in the fixed frame, for as long as is set. */
  protected draw(
    frame: string,
    count: number,
    fill: (positions: Float32Array, colours: Uint8Array) => void,
  ): void {
    const { frames } = this.context;
    const last = this.buffers.at(-1)?.buffer;
    const now = Date.now();
    this.moveTo(frame);
    if (last && Number(this.setting("decay")) > 0) {
      const pose = frames.inFixed(this.lastFrame);
      if (pose) {
        last.points.applyMatrix4(pose);
        frames.place(frames.fixed.peek()).add(last.points);
      }
    }
    this.lastFrame = frame;
    const reused = Number(this.setting("decay")) > 0 ? undefined : this.buffers.pop()?.buffer;
    const buffer = reused ?? new PointBuffer(this.size);
    buffer.set(count, fill);
    buffer.draw(this.most);
    this.group.add(buffer.points);
    this.buffers.push({ buffer, at: now });
    this.forget();
  }
  private lastFrame = "";

  private get size(): number {
    return Number(this.setting("size")) * CENTIMETRE;
  }

  /** Remove what has been there for long enough; the newest points stay. */
  private forget(): void {
    clearTimeout(this.timer);
    const decay = Number(this.setting("decay")) * 1000;
    while (this.buffers.length > 1) {
      const [first] = this.buffers as [{ buffer: PointBuffer; at: number }];
      const left = first.at + decay - Date.now();
      if (left > 0 && this.buffers.length <= MOST_KEPT) {
        this.timer = setTimeout(() => {
          this.forget();
          this.context.view.redraw();
        }, left);
        return;
      }
      first.buffer.dispose();
      this.buffers.shift();
    }
  }

  /** Options of all points. */
  protected pointOptions(colours: readonly string[], size: number): LayerOption[] {
    return [
      { kind: "choice", name: "colour", values: colours, usual: colours[0] as string },
      { kind: "choice", name: "palette", values: PALETTES, usual: "turbo" },
      { kind: "number", name: "size", least: 0.5, most: 20, step: 0.5, unit: "cm", usual: size },
      { kind: "number", name: "decay", least: 0, most: 30, step: 0.5, unit: "s", usual: 0 },
    ];
  }
}

/** Metres at which the colours of ranges end. */
const FARTHEST = 8;

/** sensor_msgs/LaserScan. */
export class ScanLayer extends PointsLayer {
  private last: Message | null = null;

  constructor(context: LayerContext) {
    super(context);
    this.options.value = this.pointOptions(["range", "intensity", "flat"], 3);
    this.hear((message) => this.take(message), { throttle: 50 });
  }

  protected override configured(): void {
    super.configured();
    if (this.last && !this.setting("decay")) this.take(this.last);
  }

  override describe({ index = -1 }: Intersection): [TextKey, string][] {
    const range = Number((this.last?.ranges as ArrayLike<number> | undefined)?.[this.found[index] ?? -1]);
    return Number.isFinite(range) ? [["scene.range", `${fixed(range, 2)} m`]] : [];
  }
  private found: number[] = [];

  private take(message: Message): void {
    const ranges = message.ranges as ArrayLike<number | null>;
    within("the number of ranges", ranges.length, 0, MOST_RANGES);
    const { angle_min, angle_increment, range_min, range_max } = message as Record<string, number>;
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
    this.last = message;
    this.found = found;
    const colour = this.setting("colour");
    const palette = paletteOf(this.setting("palette"));
    const intensities = (message.intensities ?? []) as ArrayLike<number>;
    const byIntensity = colour === "intensity" && intensities.length === ranges.length;
    const values = found.map((at) => Number((byIntensity ? intensities : ranges)[at]));
    const most = Math.min(Number(range_max), FARTHEST) || FARTHEST;
    const span = byIntensity ? (rangeOf(values) ?? [0, 1]) : ([0, most] as const);
    const isFlat = colour === "flat";
    this.legend.value = isFlat ? null : { palette, by: byIntensity ? "intensity" : "range", range: span };
    this.draw(frameOf(message), found.length, (positions, colours) => {
      found.forEach((at, index) => {
        const angle = Number(angle_min) + at * Number(angle_increment);
        const range = ranges[at] as number;
        positions[index * 3] = range * Math.cos(angle);
        positions[index * 3 + 1] = range * Math.sin(angle);
        positions[index * 3 + 2] = 0;
      });
      if (isFlat) flatten(colours, found.length);
      else paint(colours, values, palette, span);
    });
  }
}

/** Paint points in one colour that is readable on dark and light pages. */
function flatten(colours: Uint8Array, count: number): void {
  for (let at = 0; at < count; at++) colours.set([54, 150, 240, 255], at * 4);
}

/** sensor_msgs/PointCloud2, decoded by the worker. */
export class CloudLayer extends PointsLayer {
  private end: () => void = () => undefined;
  private decoding = "";
  private stride = 1;
  private readonly thinning: Thinning;

  constructor(context: LayerContext) {
    super(context);
    this.thinning = new Thinning(context.view.isSoftware);
    this.options.value = this.pointOptions(["auto", "flat"], 1);
    this.listen();
  }

  protected override configured(): void {
    super.configured();
    this.listen();
  }

  /** Have the server send as many points as are drawn, and the worker colour them as is set. */
  private listen(): void {
    const colour = String(this.setting("colour"));
    const by = colour === "auto" || colour === "flat" ? "" : colour;
    const decoding = `cloud:${paletteOf(this.setting("palette"))}:${by}` as const;
    const { stride } = this.thinning;
    this.oneOf.value = this.thinning.oneOf;
    if (decoding === this.decoding && stride === this.stride) return;
    this.decoding = decoding;
    this.stride = stride;
    const before = this.end;
    this.end = this.hear((message) => this.take(message), { throttle: 100, decoding, stride });
    before();
  }

  private take(message: Message): void {
    if (typeof message.$error === "string") throw new Error(message.$error);
    const decoded = message.$points as DecodedPoints | undefined;
    if (!decoded) return;
    this.thin(message, decoded);
    const isFlat = this.setting("colour") === "flat";
    const { by, range, fields } = decoded;
    const colours = ["auto", "flat", ...fields];
    if (colours.join() !== this.colours) {
      this.colours = colours.join();
      this.options.value = this.pointOptions(colours, 1);
    }
    const palette = paletteOf(this.setting("palette"));
    this.legend.value = range && !isFlat ? { palette, by, range } : null;
    this.draw(frameOf(message), decoded.count, (positions, colours) => {
      positions.set(decoded.positions);
      if (isFlat) flatten(colours, decoded.count);
      else colours.set(decoded.colors);
    });
  }
  private colours = "";

  private thin(message: Message, { wasCompact }: DecodedPoints): void {
    const { width, height } = message as { width: number; height: number };
    if (wasCompact) this.thinning.heard(width * height, height > 1);
    else this.thinning.reset();
    this.listen();
  }
}
