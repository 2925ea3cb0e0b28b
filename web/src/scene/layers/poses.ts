/** Poses as arrows: odometry with its trail, paths, and single or many poses. */

import {
  ArrowHelper,
  AxesHelper,
  BufferAttribute,
  BufferGeometry,
  Group,
  Line,
  LineBasicMaterial,
  type Object3D,
  Quaternion,
  Vector3,
} from "three";
import type { Message } from "../../robot/subscriptions";
import { disposeTree } from "../view";
import { frameOf, Layer, type LayerContext } from "./layer";

export interface Pose {
  position: { x: number; y: number; z: number };
  orientation: { x: number; y: number; z: number; w: number };
}

const MOST_POSES = 2000;
const MOST_PATH = 20_000;
const ARROW = 0.6;
/** Metres between the arrows of a history. */
const BETWEEN = 0.2;

/** Put an object at a pose; false where the pose is none. */
export function placeAt(object: Object3D, pose: Pose): boolean {
  const { position: p, orientation: q } = pose ?? {};
  if (!p || !q) return false;
  const turn = new Quaternion(q.x, q.y, q.z, q.w);
  const size = turn.length();
  // NaN is null in JSON.
  if (![p.x, p.y, p.z, size].every(Number.isFinite)) return false;
  // A message that was never filled in has zeros for its turn: that is no turn.
  object.quaternion.copy(size < 1e-6 ? new Quaternion() : turn.normalize());
  object.position.set(p.x, p.y, p.z);
  return true;
}

/** An arrow along x. */
export function arrow(colour: number, length = ARROW): Object3D {
  // The helper's own turn is that of its direction: the pose is its holder's.
  const along = new Vector3(1, 0, 0);
  return new Group().add(new ArrowHelper(along, new Vector3(), length, colour, length * 0.35, length * 0.22));
}

/** nav_msgs/Odometry: where it is, and where it was. */
export class OdometryLayer extends Layer {
  private readonly trail = new BufferAttribute(new Float32Array(MOST_POSES * 3), 3);
  private readonly line: Line;
  private readonly arrow = arrow(0xd9342b);
  /** Arrows where it was, the oldest first. */
  private readonly earlier: Object3D[] = [];
  private count = 0;

  constructor(context: LayerContext) {
    super(context);
    this.options.value = [
      { kind: "number", name: "trail", least: 0, most: MOST_POSES, step: 50, unit: "", usual: MOST_POSES },
      { kind: "number", name: "history", least: 0, most: 100, step: 1, unit: "", usual: 0 },
    ];
    this.line = new Line(new BufferGeometry(), new LineBasicMaterial({ color: 0xd9342b }));
    this.line.geometry.setAttribute("position", this.trail);
    this.line.geometry.setDrawRange(0, 0);
    this.line.frustumCulled = false;
    this.arrow.visible = false;
    this.group.add(this.line, this.arrow);
    this.hear((message) => this.take(message), { throttle: 100 });
  }

  protected override configured(): void {
    const shown = Math.min(this.count, Number(this.setting("trail")));
    this.line.geometry.setDrawRange(this.count - shown, shown);
    this.keep();
  }

  private take(message: Message): void {
    const pose = (message.pose as { pose: Pose }).pose;
    this.moveTo(frameOf(message));
    this.arrow.visible = placeAt(this.arrow, pose);
    if (!this.arrow.visible) throw new Error("the pose has NaN or infinite numbers");
    const { x, y, z } = pose.position;
    const last = this.count - 1;
    if (this.count && Math.hypot(x - this.trail.getX(last), y - this.trail.getY(last)) < 0.02) return;
    if (this.count === MOST_POSES) {
      // The older half gives way.
      (this.trail.array as Float32Array).copyWithin(0, (MOST_POSES / 2) * 3);
      this.count = MOST_POSES / 2;
    }
    this.trail.setXYZ(this.count++, x, y, z);
    this.trail.needsUpdate = true;
    const before = this.earlier.at(-1)?.position;
    if (this.setting("history") && (!before || before.distanceTo(this.arrow.position) >= BETWEEN)) {
      const kept = arrow(0xd98a2b, ARROW * 0.6);
      placeAt(kept, pose);
      this.group.add(kept);
      this.earlier.push(kept);
    }
    this.configured();
  }

  /** Remove arrows beyond the history. */
  private keep(): void {
    while (this.earlier.length > Number(this.setting("history"))) {
      const gone = this.earlier.shift() as Object3D;
      disposeTree(gone);
      gone.removeFromParent();
    }
  }
}

/** nav_msgs/Path: a line. */
export class PathLayer extends Layer {
  constructor(context: LayerContext) {
    super(context);
    this.hear(
      (message) => {
        const poses = ((message.poses as { pose: Pose }[]) ?? []).slice(0, MOST_PATH);
        this.clear();
        this.moveTo(frameOf(message));
        const points = poses
          .map(({ pose: { position } }) => new Vector3(position.x, position.y, position.z + 0.02))
          .filter(({ x, y, z }) => [x, y, z].every(Number.isFinite));
        const geometry = new BufferGeometry().setFromPoints(points);
        this.group.add(new Line(geometry, new LineBasicMaterial({ color: 0x1f9d55 })));
      },
      { throttle: 100 },
    );
  }
}

/** geometry_msgs/PoseStamped, PoseWithCovarianceStamped and PoseArray: an arrow or axes for each pose. */
export class PosesLayer extends Layer {
  private last: Message | null = null;

  constructor(context: LayerContext) {
    super(context);
    this.options.value = [
      { kind: "choice", name: "shape", values: ["arrow", "axes"], usual: "arrow" },
      { kind: "number", name: "size", least: 5, most: 200, step: 5, unit: "cm", usual: ARROW * 100 },
    ];
    this.hear((message) => this.take(message), { throttle: 100 });
  }

  protected override configured(): void {
    if (this.last) this.take(this.last);
  }

  private take(message: Message): void {
    const poses = posesOf(message.poses ?? message.pose);
    const size = Number(this.setting("size")) / 100;
    this.last = message;
    this.clear();
    this.moveTo(frameOf(message));
    for (const each of poses.slice(0, MOST_POSES)) {
      const shape = this.setting("shape") === "axes" ? new AxesHelper(size) : arrow(0x8a4fd3, size);
      if (placeAt(shape, each)) this.group.add(shape);
      else disposeTree(shape);
    }
  }
}

/** One pose or many; those with a covariance have theirs a level deeper. */
function posesOf(given: unknown): Pose[] {
  const list = (Array.isArray(given) ? given : [given]) as (Pose | { pose: Pose })[];
  return list.map((each) => ("pose" in each ? each.pose : each));
}
