/** Gamepads: what their sticks ask for while one of the enabling buttons is held. */

import type { Wish } from "../../robot/drive";

/** Shoulder buttons and triggers of a standard gamepad: the former drive a base, the latter move joints. */
const SHOULDERS = [4, 5];
const TRIGGERS = [6, 7];
const AXES = 4;
const DEAD_ZONE = 0.12;
const PERIOD = 50;

type Pad = Pick<Gamepad, "axes" | "buttons">;

/** Control that a gamepad holds; it is lost by a stop, a lost connection or a hidden page. */
interface Grip<Asked> {
  isHeld(): boolean;
  hold(asked: Asked): void;
  release(): void;
}

/** Motion that a gamepad asks of a base; null unless one of its shoulder buttons is held. */
export function wishOfGamepad(pad: Pad): Wish | null {
  if (!SHOULDERS.some((index) => pad.buttons[index]?.pressed)) return null;
  return { forward: axis(pad, 1), left: axis(pad, 0), turn: axis(pad, 2) };
}

/**
 * Shares of their speeds that a gamepad asks of joints, in their order: the left trigger and the four axes of the sticks
 * move the first four, the right trigger the next four; null unless a trigger is held.
 */
export function pushOfGamepad(pad: Pad, names: readonly string[]): ReadonlyMap<string, number> | null {
  const trigger = TRIGGERS.findIndex((index) => pad.buttons[index]?.pressed);
  if (trigger < 0) return null;
  const moved = names.slice(trigger * AXES, (trigger + 1) * AXES);
  return moved.length ? new Map(moved.map((name, index) => [name, axis(pad, index)])) : null;
}

/** Let the gamepads hold a control; returns the end of that. */
export function followGamepad<Asked>(asked: (pad: Pad) => Asked | null, grip: Grip<Asked>): () => void {
  // What was held before a panel was there, or was shown again, is no grip of it.
  let taken = true;
  const timer = setInterval(() => {
    const pads = navigator.getGamepads?.() ?? [];
    const wish = pads.map((pad) => pad && asked(pad)).find(Boolean);
    // What was stopped, or lost its connection or the page, begins again with another grip only.
    const isLost = taken && !grip.isHeld();
    taken = Boolean(wish);
    if (wish && !isLost && document.hasFocus()) grip.hold(wish);
    else grip.release();
  }, PERIOD);
  return () => clearInterval(timer);
}

function axis(pad: Pad, index: number): number {
  const value = pad.axes[index] ?? 0;
  return Math.abs(value) < DEAD_ZONE ? 0 : -value;
}
