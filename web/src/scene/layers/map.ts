/** nav_msgs/OccupancyGrid and its updates: a picture on the ground. */

import { effect, untracked } from "@preact/signals-core";
import {
  DataTexture,
  DoubleSide,
  Mesh,
  MeshBasicMaterial,
  NearestFilter,
  PlaneGeometry,
  SRGBColorSpace,
} from "three";
import type { Message } from "../../robot/subscriptions";
import { frameOf, Layer, type LayerContext, within } from "./layer";
import { type Pose, placeAt } from "./poses";

/** Cells along one side: what graphics cards take at least. */
const MOST_CELLS = 8192;

type Colour = readonly [red: number, green: number, blue: number];

/** Colours of free, occupied and unknown cells, on a light and a dark page: walls stand out on both. */
const LIGHT: readonly Colour[] = [
  [245, 245, 249],
  [70, 80, 94],
  [214, 220, 227],
];
const DARK: readonly Colour[] = [
  [43, 49, 58],
  [158, 168, 182],
  [22, 26, 32],
];
/** Costs from low over high to lethal. */
const COST: readonly Colour[] = [
  [42, 157, 204],
  [157, 78, 221],
  [230, 60, 160],
];

function between([one, other]: readonly Colour[], share: number): number[] {
  return [0, 1, 2].map((at) => (one?.[at] ?? 0) * (1 - share) + (other?.[at] ?? 0) * share);
}

/** Colours of a cell from -1 (unknown, as 255) over 0 (free) to 100 (occupied). */
export function mapColours(isCost: boolean, isDark = false): Uint8Array {
  const colours = new Uint8Array(256 * 4);
  const palette = isDark ? DARK : LIGHT;
  for (let value = 0; value < 256; value++) {
    const isKnown = value <= 100;
    const cost =
      value >= 99 ? [...(COST[2] as Colour), 200] : [...between(COST, value / 98), 60 + (value / 98) * 120];
    const map = [...(isKnown ? between(palette, value / 100) : (palette[2] as Colour)), 255];
    const isClear = value === 0 || !isKnown;
    colours.set(isCost ? (isClear ? [0, 0, 0, 0] : cost) : map, value * 4);
  }
  return colours;
}

export class MapLayer extends Layer {
  private texture: DataTexture | null = null;
  private colours: Uint8Array;
  private readonly isCost: boolean;

  constructor(context: LayerContext) {
    super(context);
    this.isCost = /cost/.test(context.topic);
    this.colours = mapColours(this.isCost);
    this.hear((message) => this.takeWhole(message));
    this.until(
      effect(() => {
        const isDark = context.view.dark.value;
        untracked(() => this.recolour(mapColours(this.isCost, isDark)));
      }),
    );
    const updates = `${context.topic}_updates`;
    let hears = false;
    // They may be offered later than the map, and are where the map has changed by then.
    this.until(
      effect(() => {
        if (hears || !context.session.graph.value.topics.has(updates)) return;
        hears = true;
        untracked(() => this.hear((message) => this.takePart(message), {}, updates));
      }),
    );
  }

  /** Draw every cell in other colours. */
  private recolour(colours: Uint8Array): void {
    const before = new Uint32Array(this.colours.buffer);
    const after = new Uint32Array(colours.buffer);
    this.colours = colours;
    if (!this.texture) return;
    const next = new Map(Array.from(before, (colour, value) => [colour, after[value] as number]));
    const pixels = new Uint32Array((this.texture.image.data as Uint8Array).buffer);
    for (let at = 0; at < pixels.length; at++) pixels[at] = next.get(pixels[at] as number) as number;
    this.texture.needsUpdate = true;
    this.context.view.redraw();
  }

  private takeWhole(message: Message): void {
    const info = message.info as { width: number; height: number; resolution: number; origin: Pose };
    const width = within("the map's width", info.width, 1, MOST_CELLS);
    const height = within("the map's height", info.height, 1, MOST_CELLS);
    const resolution = within("the map's resolution", info.resolution, 1e-4, 1000);
    this.clear();
    const texture = new DataTexture(new Uint8Array(width * height * 4), width, height);
    texture.colorSpace = SRGBColorSpace;
    texture.magFilter = NearestFilter;
    this.texture = texture;
    this.fill(message.data, 0, 0, width, height);
    const geometry = new PlaneGeometry(width * resolution, height * resolution);
    geometry.translate((width * resolution) / 2, (height * resolution) / 2, this.isCost ? 0.006 : -0.01);
    const mesh = new Mesh(
      geometry,
      new MeshBasicMaterial({
        map: texture,
        transparent: this.isCost,
        side: DoubleSide,
        depthWrite: !this.isCost,
      }),
    );
    if (!placeAt(mesh, info.origin)) throw new Error("the map's origin is no place");
    this.group.add(mesh);
    this.moveTo(frameOf(message));
  }

  private takePart(message: Message): void {
    if (!this.texture) return;
    const { width, height } = this.texture.image;
    const x = within("the update's x", message.x, 0, width);
    const y = within("the update's y", message.y, 0, height);
    const across = within("the update's width", message.width, 0, width - x);
    this.fill(message.data, x, y, across, within("the update's height", message.height, 0, height - y));
  }

  private fill(data: unknown, x: number, y: number, width: number, height: number): void {
    const { texture, colours } = this;
    if (!texture) return;
    const cells = data as ArrayLike<number>;
    if (cells.length < width * height)
      throw new Error(`${cells.length} cells are too few for ${width} × ${height}`);
    // Four octets at a time.
    const pixels = new Uint32Array((texture.image.data as Uint8Array).buffer);
    const palette = new Uint32Array(colours.buffer);
    for (let row = 0; row < height; row++) {
      let to = (y + row) * texture.image.width + x;
      for (let from = row * width, end = from + width; from < end; from++, to++) {
        pixels[to] = palette[(cells[from] as number) & 255] as number;
      }
    }
    texture.needsUpdate = true;
  }
}
