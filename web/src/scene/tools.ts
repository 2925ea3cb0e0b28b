/** What a click in the scene does: set a goal or a pose by dragging an arrow, or measure. */

import { type Signal, signal } from "@preact/signals-core";
import { BufferGeometry, Line, LineBasicMaterial, type Object3D, Vector3 } from "three";
import { arrow } from "./layers/poses";
import { disposeTree, type View } from "./view";

export type ToolName = "look" | "goal" | "pose" | "measure";

/** A place on the ground of the fixed frame, with a direction in radians. */
export interface Place {
  x: number;
  y: number;
  yaw: number;
}

/** Metres that the mouse must go before it gives a direction. */
const LEAST_DRAG = 0.15;

export class Tools {
  readonly chosen: Signal<ToolName> = signal("look");
  /** Metres between the two points that were clicked; NaN before. */
  readonly measured: Signal<number> = signal(Number.NaN);
  /** Called with a place that was set. */
  onPlace: (tool: "goal" | "pose", place: Place) => void = () => undefined;

  private drawn: Object3D | null = null;
  private start: Vector3 | null = null;
  private measureFrom: Vector3 | null = null;
  private readonly end: () => void;

  constructor(private readonly view: View) {
    const { canvas } = view;
    const down = (event: PointerEvent) => this.down(event);
    const move = (event: PointerEvent) => this.move(event);
    const up = (event: PointerEvent) => this.up(event);
    const key = (event: KeyboardEvent) => {
      if (event.key !== "Escape" || this.chosen.peek() === "look") return;
      event.stopPropagation();
      this.choose("look");
    };
    canvas.addEventListener("pointerdown", down, { capture: true });
    canvas.addEventListener("pointermove", move, { capture: true });
    canvas.addEventListener("pointerup", up, { capture: true });
    canvas.addEventListener("keydown", key);
    this.end = () => {
      canvas.removeEventListener("pointerdown", down, { capture: true });
      canvas.removeEventListener("pointermove", move, { capture: true });
      canvas.removeEventListener("pointerup", up, { capture: true });
      canvas.removeEventListener("keydown", key);
    };
  }

  choose(tool: ToolName): void {
    this.chosen.value = tool;
    this.start = this.measureFrom = null;
    this.erase();
    this.view.redraw();
  }

  dispose(): void {
    this.end();
    this.erase();
  }

  private down(event: PointerEvent): void {
    const tool = this.chosen.peek();
    if (tool === "look" || event.button !== 0) return;
    const point = this.view.ground(event.clientX, event.clientY);
    if (!point) return;
    event.stopImmediatePropagation();
    this.view.canvas.setPointerCapture(event.pointerId);
    if (tool === "measure") this.measure(point);
    else this.start = point;
  }

  private move(event: PointerEvent): void {
    const from = this.start ?? this.measureFrom;
    if (!from) return;
    const point = this.view.ground(event.clientX, event.clientY);
    if (!point) return;
    if (this.start) {
      event.stopImmediatePropagation();
      this.drawArrow(placeOf(this.start, point));
    } else {
      this.drawLine(from, point);
    }
  }

  private up(event: PointerEvent): void {
    const { start } = this;
    const tool = this.chosen.peek();
    if (!start || (tool !== "goal" && tool !== "pose")) return;
    event.stopImmediatePropagation();
    const point = this.view.ground(event.clientX, event.clientY) ?? start;
    this.choose("look");
    this.onPlace(tool, placeOf(start, point));
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

  private drawArrow({ x, y, yaw }: Place): void {
    this.erase();
    this.drawn = arrow(0x1f9d55, 0.9);
    this.drawn.position.set(x, y, 0.05);
    this.drawn.rotation.z = yaw;
    this.show();
  }

  private drawLine(from: Vector3, to: Vector3): void {
    this.erase();
    const lifted = [from, to].map(({ x, y, z }) => new Vector3(x, y, z + 0.03));
    this.drawn = new Line(
      new BufferGeometry().setFromPoints(lifted),
      new LineBasicMaterial({ color: 0x1f5fa8 }),
    );
    this.show();
  }

  private show(): void {
    if (this.drawn) this.view.scene.add(this.drawn);
    this.view.redraw();
  }

  private erase(): void {
    if (!this.drawn) return;
    disposeTree(this.drawn);
    this.drawn.removeFromParent();
    this.drawn = null;
  }
}

/** Where a drag began, looking to where it ended. */
export function placeOf(from: { x: number; y: number }, to: { x: number; y: number }): Place {
  const [dx, dy] = [to.x - from.x, to.y - from.y];
  return { x: from.x, y: from.y, yaw: Math.hypot(dx, dy) < LEAST_DRAG ? 0 : Math.atan2(dy, dx) };
}
