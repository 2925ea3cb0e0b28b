/** Interactive markers: drawn, dragged, turned and clicked, with feedback for the program that offers them. */

import { effect, untracked } from "@preact/signals-core";
import { Group, type Object3D, Plane, Quaternion, Vector3 } from "three";
import { keepAsking } from "../../robot/asking";
import { header } from "../../robot/names";
import type { Message } from "../../robot/subscriptions";
import { disposeTree } from "../view";
import { axisOf, type Handle, movesOf, stepOf } from "./handles";
import { Layer, type LayerContext } from "./layer";
import { drawMarker, type Marker, poseMarker } from "./markers";
import { type Pose, placeAt } from "./poses";

export interface Control {
  name: string;
  orientation: Pose["orientation"];
  interaction_mode: number;
  markers: Marker[];
}

export interface MenuEntry {
  id: number;
  parent_id: number;
  title: string;
}

interface InteractiveMarker {
  header: { frame_id: string };
  pose: Pose;
  name: string;
  description: string;
  scale: number;
  controls: Control[];
  menu_entries: MenuEntry[];
}

const POSE_UPDATE = 1;
const MENU_SELECT = 2;
const BUTTON_CLICK = 3;
const MOUSE_DOWN = 4;
const MOUSE_UP = 5;
/** Sent poses that are kept; a server need not return all of them. */
const MOST_SENT = 100;
/** Pixels that the mouse may go and still click. */
const CLICK = 4;

interface Shown {
  marker: InteractiveMarker;
  object: Group;
  /** Poses that were sent and that the server has not returned, oldest first. */
  sent: Pose[];
}

/** A control that is held, and where its marker was before. */
interface Held {
  shown: Shown;
  control: Control;
  position: Vector3;
  turn: Quaternion;
}

/** Control held by the mouse. */
interface Grip extends Held {
  start: { x: number; y: number };
  from: Vector3;
  moved: boolean;
}

/** Menu of a click. */
export interface MenuRequest {
  x: number;
  y: number;
  entries: MenuEntry[];
  choose: (id: number) => void;
}

export class InteractiveLayer extends Layer {
  private readonly markers = new Map<string, Shown>();
  private readonly feedback;
  private readonly namespace: string;
  private readonly client = `web-${crypto.getRandomValues(new Uint32Array(1)).join("")}`;
  private grip: Grip | null = null;
  /** Control held by the keyboard. */
  private taken: Held | null = null;
  private readonly may: boolean;

  constructor(
    context: LayerContext,
    private readonly onMenu: (request: MenuRequest) => void,
  ) {
    super(context);
    const { session, view } = context;
    this.namespace = context.topic.replace(/\/update(_full)?$/, "");
    const prefix = session.version.peek() === 2 ? "visualization_msgs/msg/" : "visualization_msgs/";
    this.may = session.may("publish", `${this.namespace}/feedback`);
    this.feedback = this.may
      ? session.commands.publisher(`${this.namespace}/feedback`, `${prefix}InteractiveMarkerFeedback`)
      : null;
    this.hear((message) => this.take(message));
    const full = `${this.namespace}/update_full`;
    if (session.graph.peek().topics.has(full)) this.hear((message) => this.take(message), {}, full);
    else this.until(this.ask());
    const { canvas } = view;
    const down = (event: PointerEvent) => this.down(event);
    const move = (event: PointerEvent) => this.move(event);
    const up = (event: PointerEvent) => this.up(event);
    // In front of the camera's controls, which must not turn the view while a marker is held.
    canvas.addEventListener("pointerdown", down, { capture: true });
    canvas.addEventListener("pointermove", move, { capture: true });
    canvas.addEventListener("pointerup", up, { capture: true });
    canvas.addEventListener("pointercancel", up, { capture: true });
    this.until(
      effect(() => {
        if (session.commands.block.value) untracked(() => this.drop());
      }),
    );
    this.until(() => {
      canvas.removeEventListener("pointerdown", down, { capture: true });
      canvas.removeEventListener("pointermove", move, { capture: true });
      canvas.removeEventListener("pointerup", up, { capture: true });
      canvas.removeEventListener("pointercancel", up, { capture: true });
      this.feedback?.dispose();
      for (const name of [...this.markers.keys()]) this.remove(name);
    });
  }

  private ask(): () => void {
    const { session } = this.context;
    const service = `${this.namespace}/get_interactive_markers`;
    return keepAsking(
      session,
      () => session.call(service, {}, "visualization_msgs/srv/GetInteractiveMarkers"),
      (answer) => this.take(answer),
      (reason) => {
        this.problem.value = reason;
      },
    );
  }

  private take(message: Message): void {
    for (const marker of (message.markers as InteractiveMarker[] | undefined) ?? []) this.draw(marker);
    for (const name of (message.erases as string[] | undefined) ?? []) this.remove(name);
    for (const { name, pose } of (message.poses as { name: string; pose: Pose }[] | undefined) ?? []) {
      const shown = this.markers.get(name);
      if (!shown) continue;
      shown.marker.pose = pose;
      const at = shown.sent.findIndex((sent) => isSame(sent, pose));
      shown.sent.splice(0, at + 1);
      // An older pose of this page, which the server returns late, would move the marker back.
      const isLate = at >= 0 && shown.sent.length > 0;
      const isHeld = this.grip?.shown === shown || this.taken?.shown === shown;
      if (!isHeld && !isLate) placeAt(shown.object, pose);
    }
    if (this.may) this.handles.value = [...this.markers.values()].flatMap((shown) => this.handlesOf(shown));
    this.context.view.redraw();
  }

  private draw(marker: InteractiveMarker): void {
    this.remove(marker.name);
    const { session, view, frames } = this.context;
    const object = new Group();
    const shown: Shown = { marker, object, sent: [] };
    for (const control of marker.controls) {
      for (const each of control.markers) {
        const drawn = poseMarker(
          drawMarker(each, session, () => view.redraw()),
          each.pose,
        );
        drawn.traverse((part) => {
          part.userData = { shown, control };
        });
        // A marker of a control with a frame of its own stays where it is.
        if (each.header?.frame_id) frames.place(each.header.frame_id).add(drawn);
        else object.add(drawn);
      }
    }
    if (!placeAt(object, marker.pose))
      throw new Error(`the pose of ${marker.name} has NaN or infinite numbers`);
    frames.place(marker.header.frame_id).add(object);
    this.markers.set(marker.name, shown);
  }

  private remove(name: string): void {
    const shown = this.markers.get(name);
    if (!shown) return;
    if (this.taken?.shown === shown) this.taken = null;
    disposeTree(shown.object);
    shown.object.removeFromParent();
    this.markers.delete(name);
  }

  private handlesOf(shown: Shown): Handle[] {
    const { marker } = shown;
    const controls = marker.controls.filter(({ interaction_mode: mode }) => mode !== 0);
    return controls.map((control, at) => ({
      id: `${marker.name} ${control.name} ${at}`,
      marker: marker.description || marker.name,
      control: control.name,
      moves: movesOf(control.interaction_mode),
      key: (key, far) => this.step(shown, control, key, far),
      release: (keep) => this.letGo(keep),
      press: (at) => this.click(shown, control, at, placeOf(shown.object)),
    }));
  }

  /** Take a control by the keyboard, and move it. */
  private step(shown: Shown, control: Control, key: string, far: boolean): boolean {
    const { object } = shown;
    const axis = axisOf(control.orientation, this.taken?.turn ?? object.quaternion);
    const step = stepOf(control.interaction_mode, axis, key, far);
    if (!step) return false;
    if (this.taken?.control !== control) {
      if (!this.mayCommand()) return false;
      this.letGo(false);
      this.taken = { shown, control, position: object.position.clone(), turn: object.quaternion.clone() };
      this.send(MOUSE_DOWN, shown, control, placeOf(object));
    }
    object.position.add(step.move);
    object.quaternion.premultiply(new Quaternion().setFromAxisAngle(axis, step.turn));
    this.send(POSE_UPDATE, shown, control, placeOf(object));
    this.context.view.redraw();
    return true;
  }

  private letGo(keep: boolean): void {
    const { taken } = this;
    if (!taken) return;
    const { shown, control, position, turn } = taken;
    this.taken = null;
    if (!keep) {
      shown.object.position.copy(position);
      shown.object.quaternion.copy(turn);
      this.send(POSE_UPDATE, shown, control, placeOf(shown.object));
    }
    this.send(MOUSE_UP, shown, control, placeOf(shown.object));
    this.context.view.redraw();
  }

  private hit(event: PointerEvent): { shown: Shown; control: Control; point: Vector3 } | null {
    const objects: Object3D[] = [...this.markers.values()].map(({ object }) => object);
    const [first] = this.context.view.ray(event.clientX, event.clientY).intersectObjects(objects, true);
    const owner = first?.object.userData as { shown?: Shown; control?: Control } | undefined;
    return first && owner?.shown && owner.control
      ? { shown: owner.shown, control: owner.control, point: first.point }
      : null;
  }

  private down(event: PointerEvent): void {
    if (!this.may || event.button !== 0) return;
    const hit = this.hit(event);
    if (!hit || hit.control.interaction_mode === 0) return;
    event.stopImmediatePropagation();
    if (!this.mayCommand()) return;
    this.context.view.canvas.setPointerCapture(event.pointerId);
    const { object } = hit.shown;
    this.grip = {
      shown: hit.shown,
      control: hit.control,
      start: { x: event.clientX, y: event.clientY },
      from: hit.point,
      position: object.position.clone(),
      turn: object.quaternion.clone(),
      moved: false,
    };
    this.send(MOUSE_DOWN, hit.shown, hit.control, hit.point);
  }

  private move(event: PointerEvent): void {
    const { grip } = this;
    if (!grip) return;
    event.stopImmediatePropagation();
    if (Math.hypot(event.clientX - grip.start.x, event.clientY - grip.start.y) > CLICK) grip.moved = true;
    const point = this.drag(grip, event);
    if (!grip.moved || !point) return;
    this.send(POSE_UPDATE, grip.shown, grip.control, point);
    this.context.view.redraw();
  }

  /** Move or turn what is held; returns where the mouse is. */
  private drag({ shown, control, from, position, turn }: Grip, event: PointerEvent): Vector3 | null {
    const { object } = shown;
    const { ray } = this.context.view.ray(event.clientX, event.clientY);
    const toWorld = object.parent?.getWorldQuaternion(new Quaternion()) ?? new Quaternion();
    const local = axisOf(control.orientation, turn);
    const axis = local.clone().applyQuaternion(toWorld);
    const moves = movesOf(control.interaction_mode);
    if (moves === "plane") {
      const point = ray.intersectPlane(new Plane().setFromNormalAndCoplanarPoint(axis, from), new Vector3());
      if (!point) return null;
      const step = point.clone().sub(from).applyQuaternion(toWorld.clone().invert());
      object.position.copy(position).add(step);
      return point;
    }
    if (moves === "axis") {
      const line = from.clone().addScaledVector(axis, 100);
      const onAxis = new Vector3();
      ray.distanceSqToSegment(from.clone().addScaledVector(axis, -100), line, undefined, onAxis);
      const along = onAxis.clone().sub(from).dot(axis);
      object.position.copy(position).addScaledVector(local, along);
      return onAxis;
    }
    if (moves === "turn") {
      const point = ray.intersectPlane(new Plane().setFromNormalAndCoplanarPoint(axis, from), new Vector3());
      if (!point) return null;
      const centre = object.getWorldPosition(new Vector3());
      const flat = (each: Vector3) => each.clone().sub(centre).projectOnPlane(axis).normalize();
      const [one, other] = [flat(from), flat(point)];
      const angle = Math.atan2(one.clone().cross(other).dot(axis), one.dot(other));
      object.quaternion.copy(new Quaternion().setFromAxisAngle(local, angle)).multiply(turn);
      return point;
    }
    return from;
  }

  private up(event: PointerEvent): void {
    const { grip } = this;
    if (!grip) return;
    event.stopImmediatePropagation();
    this.grip = null;
    this.send(MOUSE_UP, grip.shown, grip.control, grip.from);
    if (!grip.moved) this.click(grip.shown, grip.control, { x: event.clientX, y: event.clientY }, grip.from);
  }

  /** A control is clicked, at a place of the page and of the fixed frame: its menu opens, or it is told. */
  private click(shown: Shown, control: Control, at: { x: number; y: number }, from: Vector3): void {
    const { menu_entries: entries } = shown.marker;
    if (entries?.length) {
      this.onMenu({ ...at, entries, choose: (id) => this.send(MENU_SELECT, shown, control, from, id) });
    } else {
      this.send(BUTTON_CLICK, shown, control, from);
    }
  }

  /** True unless commands are blocked; the attempt is noted. */
  private mayCommand(): boolean {
    return this.context.session.commands.mayCommand(`${this.namespace}/feedback`, "publish");
  }

  /** Put back what is held, without a message: it counts again only once it is taken anew. */
  private drop(): void {
    for (const held of [this.grip, this.taken]) {
      held?.shown.object.position.copy(held.position);
      held?.shown.object.quaternion.copy(held.turn);
    }
    this.grip = this.taken = null;
    this.context.view.redraw();
  }

  private send(kind: number, shown: Shown, control: Control, point: Vector3, entry = 0): void {
    const { marker, object, sent } = shown;
    const { position: p, quaternion: q } = object;
    const { x, y, z } = point;
    const pose = { position: { x: p.x, y: p.y, z: p.z }, orientation: { x: q.x, y: q.y, z: q.z, w: q.w } };
    if (kind === POSE_UPDATE) {
      sent.push(pose);
      if (sent.length > MOST_SENT) sent.shift();
    }
    this.feedback?.publish({
      header: header(this.context.session.version.peek(), marker.header.frame_id),
      client_id: this.client,
      marker_name: marker.name,
      control_name: control.name,
      event_type: kind,
      pose,
      menu_entry_id: entry,
      mouse_point: { x, y, z },
      mouse_point_valid: true,
    });
  }
}

function isSame(one: Pose, other: Pose): boolean {
  const [p, q] = [one.position, other.position];
  const [r, s] = [one.orientation, other.orientation];
  return (
    p.x === q.x && p.y === q.y && p.z === q.z && r.x === s.x && r.y === s.y && r.z === s.z && r.w === s.w
  );
}

/** Where an object is in the fixed frame. */
function placeOf(object: Object3D): Vector3 {
  return object.getWorldPosition(new Vector3());
}
