/** Tools of clicks and keys in the scene: set a place by an arrow or a click, measure, or zoom. */

import { type Signal, signal } from "@preact/signals-core";
import { BufferGeometry, Line, LineBasicMaterial, type Object3D, Vector3 } from "three";
import type { Place } from "../robot/navigation";
import { FAR_STEP, STEP } from "./layers/handles";
import { arrow } from "./layers/poses";
import { disposeTree, type View } from "./view";

/** Tools that give a place; with the first ones a drag gives its direction. */
export type PlaceTool = "goal" | "pose" | "waypoint" | "point" | "inspect";
export type ToolName = "look" | "measure" | PlaceTool;

const DRAGGED: readonly ToolName[] = ["goal", "pose", "waypoint"];
/** Tools that stay chosen, for several places in turn. */
const STAYING: readonly ToolName[] = ["waypoint", "inspect"];

/** Radians by which a key turns a place. */
const TURN = Math.PI / 12;
/** To which share of its distance a key brings the camera. */
const NEARER = 0.8;
/** Where an arrow key goes, as an angle from away from the camera. */
const ARROWS: Record<string, number> = {
  ArrowUp: 0,
  ArrowLeft: Math.PI / 2,
  ArrowDown: Math.PI,
  ArrowRight: -Math.PI / 2,
};

/** Metres that the mouse must go before it gives a direction. */
const LEAST_DRAG = 0.15;

export class Tools {
  readonly chosen: Signal<ToolName> = signal("look");
  /** Metres between the two points that were clicked; NaN before. */
  readonly measured: Signal<number> = signal(Number.NaN);
  /** The place that keys move, before it is set; null before the first key. */
  readonly cursor: Signal<Place | null> = signal(null);
  /** Called with a place of the fixed frame that was set. */
  onPlace: (tool: PlaceTool, place: Place) => void = () => undefined;
  /** Called where a waypoint may be; returns what moves it to another point, or null where there is none. */
  onGrab: (at: Vector3) => ((to: Vector3) => void) | null = () => null;

  private drawn: Object3D | null = null;
  private start: Vector3 | null = null;
  private measureFrom: Vector3 | null = null;
  private grabbed: ((to: Vector3) => void) | null = null;
  private readonly end: () => void;

  constructor(private readonly view: View) {
    const { canvas } = view;
    const down = (event: PointerEvent) => this.down(event);
    const move = (event: PointerEvent) => this.move(event);
    const up = (event: PointerEvent) => this.up(event);
    const key = (event: KeyboardEvent) => {
      if (event.ctrlKey || event.altKey || event.metaKey || !this.key(event)) return;
      // In front of the camera's controls, which move by the same keys.
      event.preventDefault();
      event.stopImmediatePropagation();
    };
    canvas.addEventListener("pointerdown", down, { capture: true });
    canvas.addEventListener("pointermove", move, { capture: true });
    canvas.addEventListener("pointerup", up, { capture: true });
    canvas.addEventListener("keydown", key, { capture: true });
    this.end = () => {
      canvas.removeEventListener("pointerdown", down, { capture: true });
      canvas.removeEventListener("pointermove", move, { capture: true });
      canvas.removeEventListener("pointerup", up, { capture: true });
      canvas.removeEventListener("keydown", key, { capture: true });
    };
  }

  choose(tool: ToolName): void {
    this.chosen.value = tool;
    this.start = this.measureFrom = this.cursor.value = this.grabbed = null;
    this.erase();
    // So that the keys of the tool are heard.
    if (tool !== "look") this.view.canvas.focus({ preventScroll: true });
  }

  /** Show a place of a frame that is chosen elsewhere in the page, where no tool is in use; returns what ends that. */
  preview(place: Place, frame: Object3D): () => void {
    if (this.chosen.peek() !== "look") return () => undefined;
    const drawn = this.drawArrow(place, frame);
    return () => {
      if (this.drawn === drawn) this.erase();
    };
  }

  dispose(): void {
    this.end();
    this.erase();
  }

  /** Do what a key asks for; returns whether it asks for anything. */
  private key({ key, shiftKey }: KeyboardEvent): boolean {
    if (key === "+" || key === "=" || key === "-") {
      this.approach(key === "-" ? 1 / NEARER : NEARER);
      return true;
    }
    const tool = this.chosen.peek();
    if (tool === "look") return false;
    if (key === "Escape") {
      this.choose("look");
      return true;
    }
    const { x, y } = this.view.controls.target;
    const cursor = { ...(this.cursor.peek() ?? { x: round(x), y: round(y), yaw: 0 }) };
    if (key === "Enter" || key === " ") {
      this.set(tool, cursor);
      return true;
    }
    const arrow = ARROWS[key];
    const turn = { q: TURN, e: -TURN }[key.toLowerCase()];
    if (arrow === undefined && turn === undefined) return false;
    if (arrow !== undefined) {
      const direction = this.ahead() + arrow;
      const step = shiftKey ? FAR_STEP : STEP;
      cursor.x = round(cursor.x + step * Math.cos(direction));
      cursor.y = round(cursor.y + step * Math.sin(direction));
    }
    this.cursor.value = { ...cursor, yaw: cursor.yaw + (turn ?? 0) };
    const from = this.measureFrom;
    if (from) this.drawLine(from, new Vector3(cursor.x, cursor.y, 0));
    else this.drawArrow(this.cursor.value);
    return true;
  }

  /** Effect of Enter at a position. */
  private set(tool: Exclude<ToolName, "look">, place: Place): void {
    if (tool === "measure") {
      this.cursor.value = place;
      this.measure(new Vector3(place.x, place.y, 0));
      return;
    }
    this.place(tool, place);
  }

  private place(tool: PlaceTool, place: Place): void {
    this.choose(STAYING.includes(tool) ? tool : "look");
    this.onPlace(tool, place);
  }

  /** The axis of the ground that is nearest to away from the camera, as an angle. */
  private ahead(): number {
    const { x, y } = this.view.camera.getWorldDirection(new Vector3());
    return (Math.round(Math.atan2(y, x) / (Math.PI / 2)) * Math.PI) / 2;
  }

  private approach(share: number): void {
    const { camera, controls } = this.view;
    const from = camera.position.clone().sub(controls.target);
    const distance = from.length() * share;
    from.setLength(Math.min(Math.max(distance, controls.minDistance), controls.maxDistance));
    camera.position.copy(controls.target).add(from);
    controls.update();
    this.view.redraw();
  }

  private down(event: PointerEvent): void {
    const tool = this.chosen.peek();
    if (tool === "look" || event.button !== 0) return;
    const point = this.view.ground(event.clientX, event.clientY);
    if (!point) return;
    event.stopImmediatePropagation();
    this.view.canvas.setPointerCapture(event.pointerId);
    if (tool === "measure") this.measure(point);
    else {
      this.grabbed = tool === "waypoint" ? this.onGrab(point) : null;
      this.start = point;
    }
  }

  private move(event: PointerEvent): void {
    const from = this.start ?? this.measureFrom;
    if (!from) return;
    const point = this.view.ground(event.clientX, event.clientY);
    if (!point) return;
    if (this.start) {
      event.stopImmediatePropagation();
      if (this.grabbed) this.grabbed(point);
      else if (DRAGGED.includes(this.chosen.peek())) this.drawArrow(placeOf(this.start, point));
    } else {
      this.drawLine(from, point);
    }
  }

  private up(event: PointerEvent): void {
    const { start } = this;
    const tool = this.chosen.peek();
    if (!start || tool === "look" || tool === "measure") return;
    event.stopImmediatePropagation();
    const point = this.view.ground(event.clientX, event.clientY) ?? start;
    if (this.grabbed) {
      this.start = this.grabbed = null;
      return;
    }
    this.place(tool, DRAGGED.includes(tool) ? placeOf(start, point) : { x: point.x, y: point.y, yaw: 0 });
  }

  private measure(point: Vector3): void {
    if (this.measureFrom) {
      this.measured.value = this.measureFrom.distanceTo(point);
      this.drawLine(this.measureFrom, point);
      this.measureFrom = null;
    } else {
      this.measured.value = Number.NaN;
      this.measureFrom = point;
    }
  }

  private drawArrow({ x, y, yaw }: Place, frame: Object3D = this.view.scene): Object3D {
    const drawn = arrow(0x1f9d55, 0.9);
    drawn.position.set(x, y, 0.05);
    drawn.rotation.z = yaw;
    this.show(drawn, frame);
    return drawn;
  }

  private drawLine(from: Vector3, to: Vector3): void {
    const lifted = [from, to].map(({ x, y, z }) => new Vector3(x, y, z + 0.03));
    const material = new LineBasicMaterial({ color: 0x1f5fa8 });
    this.show(new Line(new BufferGeometry().setFromPoints(lifted), material), this.view.scene);
  }

  private show(drawn: Object3D, frame: Object3D): void {
    this.erase();
    this.drawn = drawn;
    frame.add(drawn);
    this.view.redraw();
  }

  private erase(): void {
    if (!this.drawn) return;
    disposeTree(this.drawn);
    this.drawn.removeFromParent();
    this.drawn = null;
    this.view.redraw();
  }
}

/** To a millimetre. */
function round(metres: number): number {
  return Math.round(metres * 1000) / 1000;
}

/** Where a drag began, looking to where it ended. */
export function placeOf(from: { x: number; y: number }, to: { x: number; y: number }): Place {
  const [dx, dy] = [to.x - from.x, to.y - from.y];
  return { x: from.x, y: from.y, yaw: Math.hypot(dx, dy) < LEAST_DRAG ? 0 : Math.atan2(dy, dx) };
}
