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

/** Colours of a cell from -1 (unknown, as 255) over 0 (free) to 100 (occupied). */
export function mapColours(isCost: boolean): Uint8Array {
  const colours = new Uint8Array(256 * 4);
  for (let value = 0; value < 256; value++) {
    const known = value <= 100;
    const grey = known ? 245 - value * 2.2 : 150;
    const cost =
      value === 0
        ? [0, 0, 0, 0]
        : value >= 99
          ? [170, 20, 200, 200]
          : [value * 2.5, 60, 255 - value * 2.5, 130];
    const map = known ? [grey, grey, grey + 4, 255] : [139, 147, 154, 255];
    colours.set(isCost ? (known ? cost : [0, 0, 0, 0]) : map, value * 4);
  }
  return colours;
}

export class MapLayer extends Layer {
  private texture: DataTexture | null = null;
  private readonly colours: Uint8Array;
  private readonly isCost: boolean;

  constructor(context: LayerContext) {
    super(context);
    this.isCost = /cost/.test(context.topic);
    this.colours = mapColours(this.isCost);
    this.hear((message) => this.takeWhole(message));
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
