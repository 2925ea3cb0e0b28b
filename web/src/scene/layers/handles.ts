/** Controls of interactive markers: what moves them, and how the keyboard has them, by name and in steps. */

import { Quaternion, Vector3 } from "three";

/** One control of a marker, for a list that the keyboard can reach. */
export interface Handle {
  /** Unlike those of all others of its layer. */
  id: string;
  marker: string;
  control: string;
  /** Movement; none for a button or a menu. */
  moves: "axis" | "plane" | "turn" | null;
  /** Take it, or move what is taken, by a key; false for a key that means nothing to it. */
  key(key: string, far: boolean): boolean;
  /** Let go where it is, or put it back where it was taken. */
  release(keep: boolean): void;
  /** Act on a click: open a menu at a position of the page, or send feedback of a button. */
  press(at: { x: number; y: number }): void;
}

/** Movement by mouse and arrow keys, by `interaction_mode` (visualization_msgs/InteractiveMarkerControl). */
const MOVES: Record<number, Handle["moves"]> = {
  3: "axis",
  4: "plane",
  5: "turn",
  6: "plane",
  7: "plane",
  9: "plane",
};
/** Modes whose control the keyboard turns, too. */
const TURNS = new Set([6, 9]);
/** Metres by which a key moves a marker or a place; with Shift they are more. */
export const STEP = 0.1;
export const FAR_STEP = 0.5;
const TURN = Math.PI / 24;

export function movesOf(mode: number): Handle["moves"] {
  return MOVES[mode] ?? null;
}

/** The axis of a control in the frame of its marker's pose: the x axis of its orientation. */
export function axisOf(
  orientation: { x: number; y: number; z: number; w: number },
  turn: Quaternion,
): Vector3 {
  const own = new Quaternion(orientation.x, orientation.y, orientation.z, orientation.w);
  if (own.length() < 1e-6) own.identity();
  return new Vector3(1, 0, 0).applyQuaternion(own.normalize()).applyQuaternion(turn);
}

/** By how much a key moves and turns a control with an axis; null for a key that means nothing to it. */
export function stepOf(
  mode: number,
  axis: Vector3,
  key: string,
  far: boolean,
): { move: Vector3; turn: number } | null {
  const moves = movesOf(mode);
  const sign = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[key];
  const metres = far ? FAR_STEP : STEP;
  const still = new Vector3();
  const turn = { q: TURN, e: -TURN }[key.toLowerCase()];
  if (TURNS.has(mode) && turn) return { move: still, turn };
  if (!moves || sign === undefined) return null;
  if (moves === "turn")
    return { move: still, turn: (key === "ArrowUp" || key === "ArrowLeft" ? 1 : -1) * TURN };
  if (moves === "axis") return { move: axis.clone().multiplyScalar(sign * metres), turn: 0 };
  // Forwards is x and left is y (REP 103), as far as the plane has them.
  const forward = new Vector3(1, 0, 0).projectOnPlane(axis);
  if (forward.length() < 0.1) forward.set(0, 1, 0).projectOnPlane(axis);
  forward.normalize();
  const left = axis.clone().cross(forward);
  if (left.y < -1e-9 || (Math.abs(left.y) <= 1e-9 && left.z < 0)) left.negate();
  const along = key === "ArrowUp" || key === "ArrowDown" ? forward : left.negate();
  return { move: along.multiplyScalar(sign * metres), turn: 0 };
}
