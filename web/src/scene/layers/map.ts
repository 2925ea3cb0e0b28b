/** nav_msgs/OccupancyGrid and its updates: a picture on the ground. */

import { effect, untracked } from "@preact/signals-core";
import {
  DataTexture,
  DoubleSide,
  type Intersection,
  Mesh,
  PlaneGeometry,
  RedFormat,
  ShaderMaterial,
} from "three";
import type { TextKey } from "../../i18n/text";
import type { Message } from "../../robot/subscriptions";
import { frameOf, Layer, type LayerContext, within } from "./layer";
import { type Pose, placeAt } from "./poses";

/** Cells along one side: what graphics cards take at least. */
const MOST_CELLS = 8192;

/** Cells along one side of a tile: an update sends only the tiles that it touches to the graphics card. */
const TILE = 1024;

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
/** RViz's costs: from blue to red, inscribed, lethal. */
const RVIZ: readonly Colour[] = [
  [0, 0, 255],
  [255, 0, 0],
  [0, 255, 255],
  [255, 0, 255],
];
const STYLES = ["map", "costmap", "rviz", "grey"] as const;
export type MapStyle = (typeof STYLES)[number];

function between([one, other]: readonly Colour[], share: number): number[] {
  return [0, 1, 2].map((at) => (one?.[at] ?? 0) * (1 - share) + (other?.[at] ?? 0) * share);
}

/** Colour and opacity of a cell from 0 (free) to 100 (occupied), or beyond (unknown). */
function cellColour(style: MapStyle, value: number, palette: readonly Colour[]): number[] {
  const isKnown = value <= 100;
  switch (style) {
    case "map":
      return [...(isKnown ? between(palette, value / 100) : (palette[2] as Colour)), 255];
    case "grey":
      return isKnown ? [...Array(3).fill(255 - value * 2.55), 255] : [127, 127, 127, 90];
    case "costmap":
      if (value === 0 || !isKnown) return [0, 0, 0, 0];
      if (value >= 99) return [...(COST[2] as Colour), 200];
      return [...between(COST, value / 98), 60 + (value / 98) * 120];
    case "rviz":
      if (value === 0 || !isKnown) return [0, 0, 0, 0];
      return [...(value >= 99 ? (RVIZ[value - 97] as Colour) : between(RVIZ, value / 98)), 180];
  }
}

/** Colours of a cell from -1 (unknown, as 255) over 0 (free) to 100 (occupied). */
export function mapColours(style: MapStyle, isDark = false): Uint8Array {
  const colours = new Uint8Array(256 * 4);
  for (let value = 0; value < 256; value++)
    colours.set(cellColour(style, value, isDark ? DARK : LIGHT), value * 4);
  return colours;
}

interface Tile {
  x: number;
  y: number;
  cells: DataTexture;
}

export class MapLayer extends Layer {
  private tiles: Tile[] = [];
  private size = { width: 0, height: 0 };
  /** Colours and opacity of all tiles. */
  private readonly uniforms = { palette: { value: paletteTexture() }, opacity: { value: 1 } };
  private readonly isCost: boolean;

  constructor(context: LayerContext) {
    super(context);
    this.isCost = /cost/.test(context.topic);
    this.options.value = [
      { kind: "choice", name: "palette", values: STYLES, usual: this.isCost ? "costmap" : "map" },
      { kind: "number", name: "opacity", least: 5, most: 100, step: 5, unit: "%", usual: 100 },
    ];
    this.until(
      effect(() => {
        context.view.dark.value;
        untracked(() => this.configured());
      }),
    );
    this.hear((message) => this.takeWhole(message));
    this.until(() => this.uniforms.palette.value.dispose());
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

  override describe({ object, uv }: Intersection): [TextKey, string][] {
    const tile = this.tiles.find(
      ({ cells }) => cells === (object as Mesh<never, ShaderMaterial>).material.uniforms.cells?.value,
    );
    if (!tile || !uv) return [];
    const { data, width, height } = tile.cells.image as { data: Uint8Array; width: number; height: number };
    const cell = data[Math.min(height - 1, Math.floor(uv.y * height)) * width + Math.floor(uv.x * width)];
    return [["scene.cell", cell === undefined || cell > 100 ? "–" : String(cell)]];
  }

  protected override configured(): void {
    const { palette, opacity } = this.uniforms;
    const style = STYLES.find((each) => each === this.setting("palette")) ?? "map";
    (palette.value.image.data as Uint8Array).set(mapColours(style, this.context.view.dark.peek()));
    palette.value.needsUpdate = true;
    opacity.value = Number(this.setting("opacity")) / 100;
    this.context.view.redraw();
  }

  private takeWhole(message: Message): void {
    const info = message.info as { width: number; height: number; resolution: number; origin: Pose };
    const width = within("the map's width", info.width, 1, MOST_CELLS);
    const height = within("the map's height", info.height, 1, MOST_CELLS);
    const resolution = within("the map's resolution", info.resolution, 1e-4, 1000);
    const cells = cellsOf(message.data, width * height);
    if (this.size.width !== width || this.size.height !== height || this.resolution !== resolution) {
      this.clear();
      this.tiles = [];
      this.size = { width, height };
      this.resolution = resolution;
      for (let y = 0; y < height; y += TILE) for (let x = 0; x < width; x += TILE) this.addTile(x, y);
    }
    this.fill(cells, 0, 0, width, height);
    if (!placeAt(this.group, info.origin)) throw new Error("the map's origin has NaN or infinite numbers");
    this.moveTo(frameOf(message));
  }
  private resolution = 0;

  private addTile(x: number, y: number): void {
    const { resolution, size } = this;
    const [width, height] = [Math.min(TILE, size.width - x), Math.min(TILE, size.height - y)];
    const cells = new DataTexture(new Uint8Array(width * height), width, height, RedFormat);
    cells.unpackAlignment = 1;
    const geometry = new PlaneGeometry(width * resolution, height * resolution);
    geometry.translate(
      (x + width / 2) * resolution,
      (y + height / 2) * resolution,
      this.isCost ? 0.006 : -0.01,
    );
    const material = new ShaderMaterial({
      uniforms: { ...this.uniforms, cells: { value: cells } },
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      transparent: true,
      side: DoubleSide,
      depthWrite: !this.isCost,
    });
    const mesh = new Mesh(geometry, material);
    // Under everything else that is seen through.
    mesh.renderOrder = this.isCost ? -1 : -2;
    this.group.add(mesh);
    this.tiles.push({ x, y, cells });
  }

  private takePart(message: Message): void {
    const { width, height } = this.size;
    if (!width) return;
    const x = within("the update's x", message.x, 0, width);
    const y = within("the update's y", message.y, 0, height);
    const across = within("the update's width", message.width, 0, width - x);
    const along = within("the update's height", message.height, 0, height - y);
    this.fill(cellsOf(message.data, across * along), x, y, across, along);
  }

  /** Put cells into the tiles that they lie in. */
  private fill(cells: Uint8Array, x: number, y: number, width: number, height: number): void {
    for (const tile of this.tiles) {
      const to = tile.cells.image as { data: Uint8Array; width: number; height: number };
      const [left, right] = [Math.max(x, tile.x), Math.min(x + width, tile.x + to.width)];
      const [low, high] = [Math.max(y, tile.y), Math.min(y + height, tile.y + to.height)];
      if (left >= right || low >= high) continue;
      for (let row = low; row < high; row++) {
        const from = (row - y) * width + left - x;
        to.data.set(cells.subarray(from, from + right - left), (row - tile.y) * to.width + left - tile.x);
      }
      tile.cells.needsUpdate = true;
    }
  }

  protected override clear(): void {
    for (const { cells } of this.tiles) cells.dispose();
    super.clear();
  }
}

/** Cells as octets; unknown ones are 255. */
function cellsOf(data: unknown, count: number): Uint8Array {
  const cells = data as ArrayLike<number>;
  if (!(cells?.length >= count)) throw new Error(`${cells?.length} cells are too few for ${count}`);
  if (data instanceof Uint8Array) return data;
  return data instanceof Int8Array
    ? new Uint8Array(data.buffer, data.byteOffset, data.length)
    : Uint8Array.from(cells);
}

function paletteTexture(): DataTexture {
  return new DataTexture(new Uint8Array(256 * 4), 256, 1);
}

const VERTEX = `
  varying vec2 at;
  void main() {
    at = uv;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }`;
/** Colours of a screen, not of light. */
const FRAGMENT = `
  uniform sampler2D cells;
  uniform sampler2D palette;
  uniform float opacity;
  varying vec2 at;
  void main() {
    float cell = texture2D(cells, at).r * 255.0;
    vec4 colour = texture2D(palette, vec2((cell + 0.5) / 256.0, 0.5));
    gl_FragColor = vec4(colour.rgb, colour.a * opacity);
    if (gl_FragColor.a < 0.004) discard;
  }`;
