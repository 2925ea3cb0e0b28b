/** The global `KEYBOARDTELEOP`: drives a robot with the keys of a page, as keyboardteleopjs did. */

import { EventEmitter2 } from "eventemitter2";
import { pageGlobal, type Ros, type Topic, type Vector3 } from "./globals";

export const REVISION = "0.4.0";

export interface Twist {
  linear: Vector3;
  angular: Vector3;
}

export interface TeleopOptions {
  /** The connection. */
  ros: Ros;
  /** Where `geometry_msgs/Twist` goes; by default `/cmd_vel`. */
  topic?: string;
  /** A factor of every speed that stays; by default 1. */
  throttle?: number;
}

/** Milliseconds between two commands while a key is held. */
export const COMMAND_PERIOD = 100;

/** Key code → what it adds: metres per second forward and to the left, and radians per second to the left. */
const KEYS: ReadonlyMap<number, readonly number[]> = new Map([
  [87, [0.5, 0, 0]],
  [38, [0.5, 0, 0]],
  [83, [-0.5, 0, 0]],
  [40, [-0.5, 0, 0]],
  [81, [0, 0.5, 0]],
  [69, [0, -0.5, 0]],
  [65, [0, 0, 1]],
  [37, [0, 0, 1]],
  [68, [0, 0, -1]],
  [39, [0, 0, -1]],
]);

/** Input elements in which text is written. The others only take the arrow keys. */
const BUTTONS = new Set([
  "button",
  "checkbox",
  "color",
  "file",
  "image",
  "radio",
  "range",
  "reset",
  "submit",
]);

/** Return true if an element takes a key for itself, as a text field does. */
function takesKey(target: EventTarget | null, key: number): boolean {
  if (!(target instanceof HTMLElement)) return false;
  const isArrow = key >= 37 && key <= 40;
  if (target instanceof HTMLInputElement && BUTTONS.has(target.type)) {
    return isArrow && (target.type === "range" || target.type === "radio");
  }
  return target.isContentEditable || target.matches("input, textarea, select");
}

/**
 * Drives with the arrow keys or W, A, S, D, and sideways with Q and E.
 *
 * Emits `change` with the `geometry_msgs/Twist` when the speed changes. Commands are repeated while a key is held,
 * and only then. A key counts as let go when the page loses the focus, is hidden, or loses the connection.
 */
export class Teleop extends EventEmitter2 {
  /** A factor of every speed, for a slider; it holds at once. */
  scale = 1.0;

  readonly #ros: Ros;
  readonly #throttle: number;
  readonly #commands: Topic<Twist>;
  readonly #held = new Set<number>();
  #last: readonly number[] = [0, 0, 0];
  #timer: ReturnType<typeof setInterval> | undefined;

  constructor(options: TeleopOptions) {
    super();
    this.#ros = options.ros;
    this.#throttle = options.throttle || 1.0;
    this.#commands = new (pageGlobal("ROSLIB").Topic)<Twist>({
      ros: options.ros,
      name: options.topic || "/cmd_vel",
      messageType: "geometry_msgs/Twist",
    });
    document.body.addEventListener("keydown", (event) => {
      // A key that repeats was pressed before: perhaps for another page, or for a connection that is lost.
      const ignored = event.repeat || event.ctrlKey || event.altKey || event.metaKey;
      if (!ignored && !takesKey(event.target, event.keyCode)) this.handleKey(event.keyCode, true);
    });
    document.body.addEventListener("keyup", (event) => this.handleKey(event.keyCode, false));
    window.addEventListener("blur", () => this.#release());
    window.addEventListener("pagehide", () => this.#release());
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) this.#release();
    });
    this.#ros.on("close", () => this.#release());
  }

  /** Takes a key down or up, for pages that have buttons beside the keyboard. */
  handleKey(keyCode: number, keyDown: boolean): void {
    if (!KEYS.has(keyCode) || this.#held.has(keyCode) === keyDown) return;
    if (keyDown && !this.#ros.isConnected) return;
    if (keyDown) this.#held.add(keyCode);
    else this.#held.delete(keyCode);
    this.#command();
    if (this.#held.size === 0) {
      clearInterval(this.#timer);
      this.#timer = undefined;
    } else {
      this.#timer ??= setInterval(() => this.#command(), COMMAND_PERIOD);
    }
  }

  #release(): void {
    for (const key of [...this.#held]) this.handleKey(key, false);
  }

  #command(): void {
    const speed = this.#throttle * this.scale;
    const sum = [0, 1, 2].map((axis) => {
      let total = 0;
      for (const key of this.#held) total += (KEYS.get(key)?.[axis] ?? 0) * speed;
      return total;
    });
    const [forward = 0, left = 0, turn = 0] = sum;
    const twist = { linear: { x: forward, y: left, z: 0 }, angular: { x: 0, y: 0, z: turn } };
    // roslib keeps what is published without a connection and sends it with the next one, when no key is held any more.
    if (this.#ros.isConnected) this.#commands.publish(twist);
    if (sum.some((value, axis) => value !== this.#last[axis])) {
      this.#last = sum;
      this.emit("change", twist);
    }
  }
}
