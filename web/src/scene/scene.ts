/** The scene of a robot: every topic that can be drawn, by its type. */

import { effect, type Signal, signal, untracked } from "@preact/signals-core";
import type { Object3D } from "three";
import { shortType } from "../robot/names";
import type { RobotSession } from "../robot/session";
import { type DrawableType, isDescription, isDrawable, isDrawn } from "./drawable";
import { Frames } from "./frames";
import type { Detail } from "./governor";
import { CloudLayer, ScanLayer } from "./layers/clouds";
import { FrameAxes } from "./layers/frame_axes";
import { InteractiveLayer, type MenuRequest } from "./layers/interactive";
import type { Layer, LayerContext, LayerSettings } from "./layers/layer";
import { MapLayer } from "./layers/map";
import { MarkersLayer } from "./layers/markers";
import { OdometryLayer, PathLayer, PosesLayer } from "./layers/poses";
import { RobotLayer } from "./layers/robot";
import type { Quality } from "./quality";
import { Tools } from "./tools";
import { View } from "./view";

type MakeLayer = (context: LayerContext, scene: RobotScene) => Layer;

/** Layer of each message type. Types are written without `/msg/`. */
const MAKERS: Record<DrawableType, MakeLayer> = {
  "nav_msgs/OccupancyGrid": (context) => new MapLayer(context),
  "nav_msgs/Odometry": (context) => new OdometryLayer(context),
  "nav_msgs/Path": (context) => new PathLayer(context),
  "sensor_msgs/LaserScan": (context) => new ScanLayer(context),
  "sensor_msgs/PointCloud2": (context) => new CloudLayer(context),
  "geometry_msgs/PoseStamped": (context) => new PosesLayer(context),
  "geometry_msgs/PoseWithCovarianceStamped": (context) => new PosesLayer(context),
  "geometry_msgs/PoseArray": (context) => new PosesLayer(context),
  "visualization_msgs/Marker": (context) => new MarkersLayer(context),
  "visualization_msgs/MarkerArray": (context) => new MarkersLayer(context),
  "visualization_msgs/InteractiveMarkerUpdate": (context, scene) =>
    new InteractiveLayer(context, (request) => {
      scene.menu.value = request;
    }),
};

const MOST_LAYERS = 60;

/** Something that is drawn, and the point of it in the fixed frame, in metres. */
export interface Picked {
  topic: string;
  type: string;
  layer: Layer;
  point: { x: number; y: number; z: number };
  rows: ReturnType<Layer["describe"]>;
}

/** True if an object and everything above it is visible. */
function isShown(object: Object3D | null): boolean {
  return object === null || (object.visible && isShown(object.parent));
}

/** One row of the list of layers. */
export interface LayerRow {
  topic: string;
  type: string;
  /** null while it is not shown. */
  layer: Layer | null;
}

export class RobotScene {
  readonly view: View;
  readonly frames: Frames;
  readonly tools: Tools;
  readonly axes: FrameAxes;
  /** Every topic that can be drawn. */
  readonly rows: Signal<LayerRow[]> = signal([]);
  /** A menu that a click on a marker asks for. */
  readonly menu: Signal<MenuRequest | null> = signal(null);
  /** The frame that the camera moves with; empty for none. */
  readonly followed: Signal<string> = signal("");

  /** True if the camera begins above the robot. */
  fromAbove = false;

  private readonly endDiscovery: () => void;
  private last: { x: number; y: number } | null = null;
  /** The fixed frame in which the camera was turned to the robot. */
  private lookedIn = "";
  private touched = false;

  /**
   * @param session the robot
   * @param host where it is drawn
   * @param wanted layers that are shown or hidden by choice, by topic
   * @param quality how finely it is drawn
   * @param settings how layers are drawn by choice, by topic
   */
  constructor(
    private readonly session: RobotSession,
    host: HTMLElement,
    private readonly wanted: Record<string, boolean> = {},
    quality: Quality = "auto",
    private readonly settings: Record<string, LayerSettings> = {},
  ) {
    this.view = new View(host, quality);
    this.frames = new Frames(session, this.view.scene);
    this.tools = new Tools(this.view);
    this.axes = new FrameAxes(this.frames, this.view);
    this.view.controls.addEventListener("start", () => {
      this.touched = true;
    });
    this.frames.onMove = () => this.view.redraw();
    this.view.beforeDraw = (detail) => this.beforeDraw(detail);
    this.endDiscovery = effect(() => {
      const { topics } = session.graph.value;
      untracked(() => this.discover(topics));
    });
  }

  dispose(): void {
    this.endDiscovery();
    for (const { layer } of this.rows.peek()) layer?.dispose();
    this.axes.dispose();
    this.tools.dispose();
    this.frames.dispose();
    this.view.dispose();
  }

  /** Show or hide a topic. */
  show(topic: string, shown: boolean): void {
    this.wanted[topic] = shown;
    this.rows.value = this.rows.peek().map((row) => {
      if (row.topic !== topic || (row.layer !== null) === shown) return row;
      row.layer?.dispose();
      return { ...row, layer: shown ? this.make(row.topic, row.type) : null };
    });
  }

  /** Set how a topic is drawn. */
  configure(topic: string, settings: LayerSettings): void {
    this.settings[topic] = settings;
    this.rows
      .peek()
      .find((row) => row.topic === topic)
      ?.layer?.configure(settings);
  }

  /** What is drawn at a point of the page; null for nothing. */
  pick(clientX: number, clientY: number): Picked | null {
    const ray = this.view.ray(clientX, clientY);
    ray.params.Points.threshold = Math.max(
      0.03,
      0.006 * this.view.camera.position.distanceTo(this.view.controls.target),
    );
    ray.params.Line.threshold = ray.params.Points.threshold;
    let nearest: (Picked & { distance: number }) | null = null;
    for (const { topic, type, layer } of this.rows.peek()) {
      if (!layer) continue;
      const objects = layer.objects.filter((object) => isShown(object));
      // The ground is below everything else at the same distance.
      const allowance = shortType(type) === "nav_msgs/OccupancyGrid" ? 0.2 : 0;
      const hit = ray.intersectObjects([...objects], true).find(({ object }) => isShown(object));
      const distance = (hit?.distance ?? 0) + allowance;
      if (!hit || (nearest && nearest.distance <= distance)) continue;
      const { x, y, z } = hit.point;
      nearest = { topic, type, layer, point: { x, y, z }, rows: layer.describe(hit), distance };
    }
    return nearest;
  }

  /** The robot's own frame, where there is a usual one. */
  get base(): string {
    const names = this.frames.names;
    return ["base_footprint", "base_link", "base"].find((name) => names.includes(name)) ?? "";
  }

  /** Keep the camera at the robot, or leave it where it is. */
  follow(following: boolean): void {
    this.followed.value = following ? this.base : "";
    this.last = null;
    this.view.redraw();
  }

  /** Where the robot is on the ground; the origin while that is not known. */
  get robotPlace(): { x: number; y: number; yaw: number } {
    return (this.base && this.frames.pose(this.base)) || { x: 0, y: 0, yaw: 0 };
  }

  /** Look at the robot from above, or obliquely. */
  look(fromAbove: boolean): void {
    // It stays so where the robot or the frame is only found later.
    this.fromAbove = fromAbove;
    const { x, y } = this.robotPlace;
    if (fromAbove) this.view.lookFromAbove(x, y);
    else this.view.lookAt(x, y);
  }

  private discover(topics: ReadonlyMap<string, string>): void {
    const rows = this.rows.peek();
    const known = new Set(rows.map(({ topic }) => topic));
    const found = [...topics]
      .filter(([topic, type]) => !known.has(topic) && isDrawable(topic, type))
      .filter(([topic]) => this.session.may("subscribe", topic))
      .slice(0, MOST_LAYERS - rows.length)
      .map(([topic, type]) => {
        return { topic, type, layer: isDrawn(topic, this.wanted) ? this.make(topic, type) : null };
      });
    // A topic that has gone may come back: its layer stays.
    if (found.length)
      this.rows.value = [...rows, ...found].sort((one, other) => (one.topic < other.topic ? -1 : 1));
  }

  private make(topic: string, type: string): Layer | null {
    const { session, frames, view } = this;
    const context = { session, frames, view, topic, type, settings: this.settings[topic] ?? {} };
    if (isDescription(topic, type)) return new RobotLayer(context);
    return MAKERS[shortType(type) as DrawableType]?.(context, this) ?? null;
  }

  private beforeDraw(detail: Detail): void {
    for (const { layer } of this.rows.peek()) layer?.prepare(detail);
    this.frames.update();
    this.axes.update();
    const fixed = this.frames.fixed.peek();
    if (!this.touched && this.lookedIn !== fixed && this.base && this.frames.pose(this.base)) {
      this.lookedIn = fixed;
      this.look(this.fromAbove);
    }
    const pose = this.followed.peek() ? this.frames.pose(this.followed.peek()) : null;
    if (pose && this.last) this.view.follow(pose.x - this.last.x, pose.y - this.last.y);
    this.last = pose;
  }
}
