/** Frames as the robot tells them on /tf and /tf_static, and places in them that objects hang on. */

import { type Signal, signal } from "@preact/signals-core";
import { Group, Matrix4, type Object3D, Quaternion, Vector3 } from "three";
import { frameName, seconds } from "../robot/names";
import type { RobotSession } from "../robot/session";
import type { Message } from "../robot/subscriptions";

/** Last received pose of a frame in its parent. */
export interface Frame {
  parent: string;
  matrix: Matrix4;
  /** When it was told, by this page's clock in milliseconds. */
  at: number;
  /** Stamp in seconds of the robot's clock. */
  stamp: number;
  isStatic: boolean;
}

interface Transform {
  header: { frame_id: string; stamp: unknown };
  child_frame_id: string;
  transform: {
    translation: { x: number; y: number; z: number };
    rotation: { x: number; y: number; z: number; w: number };
  };
}

/** A way up the tree that is longer is taken for a circle. */
const MOST_ANCESTORS = 100;
const MOST_FRAMES = 5000;
/** Milliseconds for which a frame may be missing: transforms often come after the first messages. */
const LOST_FOR = 2000;
const USUAL_FIXED = ["map", "odom", "world"];

export class Frames {
  readonly tree = new Map<string, Frame>();
  /** Counts up when a frame appears or gets another parent. */
  readonly changed: Signal<number> = signal(0);
  /** The frame in which everything is drawn. */
  readonly fixed: Signal<string> = signal("");
  /** Frames in which something is to be drawn, and that no transform has connected to the fixed one for a while. */
  readonly unreachable: Signal<readonly string[]> = signal([]);
  /** Called when anything moved. */
  onMove: () => void = () => undefined;

  private readonly places = new Map<string, Group>();
  private readonly ends: (() => void)[];
  private chosen = false;
  /** Since when each frame cannot be reached, in milliseconds by this page's clock. */
  private readonly lostSince = new Map<string, number>();

  /** `root` is where the places are added, drawn in the fixed frame. */
  constructor(
    session: RobotSession,
    private readonly root: Object3D = new Group(),
  ) {
    this.ends = ["/tf", "/tf_static"].map((topic) => {
      const type = session.graph.peek().topics.get(topic) ?? "tf2_msgs/TFMessage";
      return session.subscribe(topic, type, (message) => this.take(message, topic === "/tf_static"));
    });
  }

  dispose(): void {
    for (const end of this.ends) end();
  }

  /** Every frame that is known, parents included, sorted. */
  get names(): string[] {
    const names = new Set(this.tree.keys());
    for (const { parent } of this.tree.values()) names.add(parent);
    return [...names].sort();
  }

  /** Draw in this frame from now on. */
  fix(name: string): void {
    this.chosen = true;
    this.fixed.value = name;
    this.onMove();
  }

  /** Where objects of a frame hang; hidden while the frame cannot be reached from the fixed one. */
  place(name: string): Group {
    const frame = frameName(name);
    let place = this.places.get(frame);
    if (!place) {
      place = new Group();
      place.name = `frame ${frame}`;
      place.matrixAutoUpdate = false;
      this.places.set(frame, place);
      this.root.add(place);
    }
    return place;
  }

  /** Pose of a frame in the fixed one; null if it is not known. */
  inFixed(name: string): Matrix4 | null {
    const frame = frameName(name);
    const fixed = this.fixed.peek();
    if (frame === fixed) return new Matrix4();
    const here = this.up(frame);
    const there = this.up(fixed);
    if (here.root !== there.root) return null;
    return there.matrix.invert().multiply(here.matrix);
  }

  /** Put every place where its frame is now; one in which nothing hangs any more goes. */
  update(): void {
    for (const [name, place] of this.places) {
      if (!place.children.length) {
        this.places.delete(name);
        this.lostSince.delete(name);
        this.root.remove(place);
        continue;
      }
      const matrix = this.inFixed(name);
      place.visible = matrix !== null;
      if (!matrix) {
        if (!this.lostSince.has(name)) {
          this.lostSince.set(name, Date.now());
          setTimeout(() => this.onMove(), LOST_FOR);
        }
        continue;
      }
      this.lostSince.delete(name);
      place.matrix.copy(matrix);
      place.matrixWorldNeedsUpdate = true;
    }
    const due = Date.now() - LOST_FOR;
    const lost = [...this.lostSince].filter(([, since]) => since <= due).map(([name]) => name);
    if (lost.join() !== this.unreachable.peek().join()) this.unreachable.value = lost;
  }

  /** Where a frame is and how it is turned about z, in the fixed frame. */
  pose(name: string): { x: number; y: number; z: number; yaw: number } | null {
    const matrix = this.inFixed(name);
    if (!matrix) return null;
    const { x, y, z } = new Vector3().setFromMatrixPosition(matrix);
    const [e0 = 1, e1 = 0] = matrix.elements;
    return { x, y, z, yaw: Math.atan2(e1, e0) };
  }

  private up(name: string): { root: string; matrix: Matrix4 } {
    const matrix = new Matrix4();
    let root = name;
    for (let step = 0; step < MOST_ANCESTORS; step++) {
      const frame = this.tree.get(root);
      if (!frame) return { root, matrix };
      matrix.premultiply(frame.matrix);
      root = frame.parent;
    }
    return { root: `a circle at ${name}`, matrix };
  }

  private take(message: Message, isStatic: boolean): void {
    const now = Date.now();
    let isNew = false;
    for (const each of (message.transforms as Transform[] | undefined) ?? []) {
      const child = frameName(each.child_frame_id);
      const parent = frameName(each.header?.frame_id);
      const { translation: p, rotation: q } = each.transform ?? {};
      if (!p || !q) continue;
      const turn = new Quaternion(q.x, q.y, q.z, q.w);
      const size = turn.length();
      // A transform with NaN in it, or without a direction, is none.
      if (!child || !parent || ![p.x, p.y, p.z, size].every(Number.isFinite) || size < 1e-6) continue;
      const known = this.tree.get(child);
      if (!known && this.tree.size >= MOST_FRAMES) continue;
      if (known?.parent !== parent) isNew = true;
      this.tree.set(child, {
        parent,
        matrix: new Matrix4().compose(new Vector3(p.x, p.y, p.z), turn.normalize(), new Vector3(1, 1, 1)),
        at: now,
        stamp: seconds(each.header.stamp),
        isStatic,
      });
    }
    if (isNew) {
      if (!this.chosen) this.fixed.value = this.likelyFixed();
      this.changed.value++;
    }
    this.onMove();
  }

  private likelyFixed(): string {
    const names = new Set(this.names);
    const usual = USUAL_FIXED.find((name) => names.has(name));
    if (usual) return usual;
    const [first] = this.tree.keys();
    return first === undefined ? "" : this.up(first).root;
  }
}
