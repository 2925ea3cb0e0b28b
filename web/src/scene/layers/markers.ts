/** visualization_msgs/Marker and MarkerArray, every type of them. */

import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  Color,
  CylinderGeometry,
  DoubleSide,
  Group,
  InstancedMesh,
  type Intersection,
  Matrix4,
  Mesh,
  MeshLambertMaterial,
  type Object3D,
  Points,
  PointsMaterial,
  Quaternion,
  SphereGeometry,
  Vector3,
} from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import { CSS2DObject } from "three/addons/renderers/CSS2DRenderer.js";
import { plain } from "../../i18n/plain";
import type { TextKey } from "../../i18n/text";
import type { RobotSession } from "../../robot/session";
import { disposeTree, METRE_OF_POINTS } from "../view";
import { Layer, type LayerContext } from "./layer";
import { loadMesh } from "./meshes";
import { type Pose, placeAt } from "./poses";

interface Xyz {
  x: number;
  y: number;
  z: number;
}
interface Rgba {
  r: number;
  g: number;
  b: number;
  a: number;
}

/** A marker as it comes. */
export interface Marker {
  header: { frame_id: string };
  ns: string;
  id: number;
  type: number;
  action: number;
  pose: Pose;
  scale: Xyz;
  color: Rgba;
  lifetime: { sec?: number; nanosec?: number; secs?: number; nsecs?: number };
  points: Xyz[];
  colors: Rgba[];
  text: string;
  mesh_resource: string;
  mesh_use_embedded_materials: boolean;
}

const MOST_MARKERS = 10_000;
const TOO_MANY = `more than ${MOST_MARKERS} markers`;
const MOST_POINTS = 200_000;
const MOST_LABEL = 500;
/** Milliseconds for which markers are built at a time: keys and other messages come between. */
const SLICE_MS = 8;
/** Namespaces that can be switched. */
const MOST_NAMESPACES = 50;
/** Metres, of lines without a width. */
const THINNEST = 0.01;
const Y_TO_X = new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), new Vector3(1, 0, 0));
const Y_TO_Z = new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), new Vector3(0, 0, 1));

function colourOf({ r, g, b }: Rgba): Color {
  return new Color().setRGB(r, g, b, "srgb");
}

function surface({ color }: Pick<Marker, "color">, opacity = color.a): MeshLambertMaterial {
  const material = new MeshLambertMaterial({ color: colourOf(color), side: DoubleSide });
  if (opacity < 1) Object.assign(material, { transparent: true, opacity, depthWrite: false });
  return material;
}

function vectors(points: Xyz[]): Vector3[] {
  if (points.length > MOST_POINTS) throw new Error(`a marker of ${points.length} points`);
  return points.map(({ x, y, z }) => new Vector3(x, y, z));
}

function geometryOf(points: Xyz[], colors: Rgba[]): BufferGeometry {
  const geometry = new BufferGeometry().setFromPoints(vectors(points));
  if (colors.length === points.length && colors.length) {
    const values = new Float32Array(colors.length * 3);
    colors.forEach((color, at) => {
      colourOf(color).toArray(values, at * 3);
    });
    geometry.setAttribute("color", new BufferAttribute(values, 3));
  }
  return geometry;
}

function hasColours(marker: Marker): boolean {
  return marker.colors.length > 0 && marker.colors.length === marker.points.length;
}

/** Lines as wide as `scale.x` says, in metres: between each two points, or between those of each pair. */
function lines(marker: Marker, isStrip: boolean): Object3D {
  const { points, colors, color, scale } = marker;
  const own = hasColours(marker);
  const at = vectors(points);
  const order: number[] = [];
  for (let from = 0; from + 1 < at.length; from += isStrip ? 1 : 2) order.push(from, from + 1);
  const geometry = new LineSegmentsGeometry();
  geometry.setPositions(order.flatMap((each) => (at[each] as Vector3).toArray()));
  if (own) geometry.setColors(order.flatMap((each) => colourOf(colors[each] as Rgba).toArray()));
  const material = new LineMaterial({
    color: own ? 0xffffff : colourOf(color).getHex(),
    vertexColors: own,
    worldUnits: true,
    linewidth: scale.x > 0 ? scale.x : THINNEST,
    transparent: color.a > 0 && color.a < 1,
    opacity: color.a || 1,
    side: DoubleSide,
  });
  const drawn = new LineSegments2(geometry, material);
  drawn.frustumCulled = false;
  return drawn;
}

/** One shape at each point. */
function instances(marker: Marker, shape: BufferGeometry): Object3D {
  const { points, colors, scale } = marker;
  if (points.length > MOST_POINTS) throw new Error(`a marker of ${points.length} points`);
  const mesh = new InstancedMesh(shape, surface(marker, marker.color.a || 1), points.length);
  const size = new Vector3(scale.x, scale.y, scale.z);
  points.forEach(({ x, y, z }, at) => {
    mesh.setMatrixAt(at, new Matrix4().compose(new Vector3(x, y, z), new Quaternion(), size));
    const color = colors[at];
    if (color && hasColours(marker)) mesh.setColorAt(at, colourOf(color));
  });
  if (hasColours(marker)) mesh.material = surface({ color: { r: 1, g: 1, b: 1, a: marker.color.a || 1 } });
  mesh.frustumCulled = false;
  return mesh;
}

/** An arrow of a shaft and a head along x, in the proportions of rviz. */
function arrowShape(marker: Marker): Object3D {
  const { scale, points } = marker;
  const group = new Group();
  const material = surface(marker);
  let length = scale.x;
  let shaft = scale.y / 2;
  let head = scale.y;
  let headLength = length * 0.23;
  if (points.length >= 2) {
    const [from, to] = vectors(points.slice(0, 2)) as [Vector3, Vector3];
    const along = to.clone().sub(from);
    length = along.length();
    shaft = scale.x / 2;
    head = scale.y / 2;
    headLength = scale.z || length * 0.23;
    group.position.copy(from);
    group.quaternion.setFromUnitVectors(new Vector3(1, 0, 0), along.normalize());
  }
  headLength = Math.min(headLength, length);
  const body = new Mesh(new CylinderGeometry(shaft, shaft, length - headLength, 12), material);
  body.quaternion.copy(Y_TO_X);
  body.position.x = (length - headLength) / 2;
  const tip = new Mesh(new CylinderGeometry(0, head, headLength, 16), material);
  tip.quaternion.copy(Y_TO_X);
  tip.position.x = length - headLength / 2;
  group.add(body, tip);
  return group;
}

/** Draw a marker in its own pose's frame; a mesh comes later. Throws for types that there are not. */
export function drawMarker(marker: Marker, session: RobotSession, redraw: () => void): Object3D {
  const { scale, points, colors } = marker;
  switch (marker.type) {
    case 0:
      return arrowShape(marker);
    case 1:
      return scaled(new Mesh(new BoxGeometry(), surface(marker)), scale);
    case 2:
      return scaled(new Mesh(new SphereGeometry(0.5, 24, 16), surface(marker)), scale);
    case 3: {
      const cylinder = new Mesh(new CylinderGeometry(0.5, 0.5, 1, 32), surface(marker));
      cylinder.geometry.applyQuaternion(Y_TO_Z);
      return scaled(cylinder, scale);
    }
    case 4:
    case 5:
      return lines(marker, marker.type === 4);
    case 6:
      return instances(marker, new BoxGeometry());
    case 7:
      return instances(marker, new SphereGeometry(0.5, 12, 8));
    case 8: {
      const own = hasColours(marker);
      const color = own ? 0xffffff : colourOf(marker.color);
      return new Points(
        geometryOf(points, colors),
        new PointsMaterial({ size: scale.x * METRE_OF_POINTS, color, vertexColors: own }),
      );
    }
    case 9: {
      const element = document.createElement("span");
      element.className = "scene-text";
      element.textContent = plain(marker.text.slice(0, MOST_LABEL));
      element.style.color = `#${colourOf(marker.color).getHexString()}`;
      return new CSS2DObject(element);
    }
    case 10:
      return scaled(loadMesh(session, marker.mesh_resource, surface(marker), redraw), scale);
    case 11: {
      const geometry = geometryOf(points, colors);
      geometry.computeVertexNormals();
      const material = surface(marker, marker.color.a || 1);
      if (hasColours(marker)) Object.assign(material, { vertexColors: true, color: new Color(0xffffff) });
      return scaled(new Mesh(geometry, material), scale);
    }
    case 12: {
      const group = new Group();
      for (let at = 0; at + 1 < Math.min(points.length, 1000); at++) {
        group.add(arrowShape({ ...marker, points: points.slice(at, at + 2) }));
      }
      return group;
    }
    default:
      throw new Error(`there is no marker of type ${marker.type}`);
  }
}

function scaled<T extends Object3D>(object: T, { x, y, z }: Xyz): T {
  if (![x, y, z].every(Number.isFinite)) throw new Error("a marker's scale is no number");
  object.scale.set(x, y, z);
  return object;
}

/** Put a drawn marker where it belongs. */
export function poseMarker(object: Object3D, pose: Pose): Object3D {
  const holder = new Group();
  if (!placeAt(holder, pose)) throw new Error("a marker's pose has NaN or infinite numbers");
  holder.add(object);
  return holder;
}

export class MarkersLayer extends Layer {
  private readonly markers = new Map<string, { object: Object3D; timer?: ReturnType<typeof setTimeout> }>();
  /** Markers that are not built yet, by their keys; of each the newest. */
  private readonly pending = new Map<string, Marker>();
  private slice: ReturnType<typeof setTimeout> | undefined;
  /** The first fault since all was built. */
  private fault = "";

  constructor(context: LayerContext) {
    super(context);
    this.hear((message) => {
      if (!this.pending.size) this.fault = "";
      const list = (message.markers as Marker[] | undefined) ?? [message as unknown as Marker];
      for (const marker of list) this.enqueue(marker);
      this.build();
      if (this.fault) throw new Error(this.fault);
    });
    this.until(() => {
      clearTimeout(this.slice);
      this.pending.clear();
      this.removeAll();
    });
  }

  private enqueue(marker: Marker): void {
    if (marker.action === 3) {
      this.pending.clear();
      this.removeAll();
      return;
    }
    const key = `${marker.ns}\u0000${marker.id}`;
    if (!this.pending.delete(key) && this.pending.size >= MOST_MARKERS) this.fault ||= TOO_MANY;
    else this.pending.set(key, marker);
  }

  /** Build markers for a moment, and the others later. */
  private build(): void {
    clearTimeout(this.slice);
    const end = performance.now() + SLICE_MS;
    for (const [key, marker] of this.pending) {
      this.pending.delete(key);
      try {
        this.take(key, marker);
      } catch (error) {
        this.fault ||= (error as Error).message;
      }
      if (performance.now() >= end) break;
    }
    if (!this.pending.size) return;
    this.slice = setTimeout(() => {
      this.build();
      if (this.fault) this.problem.value = this.fault;
      this.context.view.redraw();
    });
  }

  override get objects(): readonly Object3D[] {
    return [...this.markers.values()].map(({ object }) => object);
  }

  override describe({ object }: Intersection): [TextKey, string][] {
    for (let at: Object3D | null = object; at; at = at.parent) {
      const found = [...this.markers].find(([, marker]) => marker.object === at);
      if (found) return [["scene.marker", found[0].replace("\u0000", " · ")]];
    }
    return [];
  }

  protected override configured(): void {
    for (const [key, { object }] of this.markers) object.visible = this.shows(key);
  }

  /** True if the namespace of a marker is shown. */
  private shows(key: string): boolean {
    return this.setting(`namespace ${key.slice(0, key.indexOf("\u0000"))}`) !== false;
  }

  /** Offer a switch for each namespace. */
  private know(ns: string): void {
    const options = this.options.peek();
    const name = `namespace ${ns}` as const;
    if (options.length >= MOST_NAMESPACES || options.some((each) => each.name === name)) return;
    this.options.value = [...options, { kind: "switch", name, label: ns || "–", usual: true }];
  }

  private take(key: string, marker: Marker): void {
    this.remove(key);
    if (marker.action === 2) return;
    if (this.markers.size >= MOST_MARKERS) {
      this.fault ||= TOO_MANY;
      return;
    }
    const { session, view, frames } = this.context;
    const object = poseMarker(
      drawMarker(marker, session, () => view.redraw()),
      marker.pose,
    );
    this.know(String(marker.ns));
    object.visible = this.shows(key);
    frames.place(marker.header.frame_id).add(object);
    const { sec, secs, nanosec, nsecs } = marker.lifetime ?? {};
    const lifetime = Number(sec ?? secs ?? 0) * 1000 + Number(nanosec ?? nsecs ?? 0) / 1e6;
    const entry: { object: Object3D; timer?: ReturnType<typeof setTimeout> } = { object };
    if (lifetime > 0) {
      entry.timer = setTimeout(() => {
        this.remove(key);
        view.redraw();
      }, lifetime);
    }
    this.markers.set(key, entry);
  }

  private remove(key: string): void {
    const known = this.markers.get(key);
    if (!known) return;
    clearTimeout(known.timer);
    disposeTree(known.object);
    known.object.removeFromParent();
    this.markers.delete(key);
  }

  private removeAll(): void {
    for (const key of [...this.markers.keys()]) this.remove(key);
  }
}
