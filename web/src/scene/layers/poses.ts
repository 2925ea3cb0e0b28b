/** Poses as arrows: odometry with its trail, paths, and single or many poses. */

import {
  ArrowHelper,
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
  private count = 0;

  constructor(context: LayerContext) {
    super(context);
    this.line = new Line(new BufferGeometry(), new LineBasicMaterial({ color: 0xd9342b }));
    this.line.geometry.setAttribute("position", this.trail);
    this.line.geometry.setDrawRange(0, 0);
    this.line.frustumCulled = false;
    this.arrow.visible = false;
    this.group.add(this.line, this.arrow);
    this.hear((message) => this.take(message), { throttle: 100 });
  }

  private take(message: Message): void {
    const pose = (message.pose as { pose: Pose }).pose;
    this.moveTo(frameOf(message));
    this.arrow.visible = placeAt(this.arrow, pose);
    if (!this.arrow.visible) throw new Error("the pose is no place");
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
    this.line.geometry.setDrawRange(0, this.count);
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

/** geometry_msgs/PoseStamped, PoseWithCovarianceStamped and PoseArray: an arrow for each pose. */
export class PosesLayer extends Layer {
  constructor(context: LayerContext) {
    super(context);
    this.hear(
      (message) => {
        const poses = posesOf(message.poses ?? message.pose);
        this.clear();
        this.moveTo(frameOf(message));
        for (const each of poses.slice(0, MOST_POSES)) {
          const shape = arrow(0x8a4fd3);
          if (placeAt(shape, each)) this.group.add(shape);
          else disposeTree(shape);
        }
      },
      { throttle: 100 },
    );
  }
}

/** One pose or many; those with a covariance have theirs a level deeper. */
function posesOf(given: unknown): Pose[] {
  const list = (Array.isArray(given) ? given : [given]) as (Pose | { pose: Pose })[];
  return list.map((each) => ("pose" in each ? each.pose : each));
}
