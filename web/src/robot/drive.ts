/** Driving a robot by hand: hold to run. Nothing is sent unless somebody holds a control. */

import { effect, type Signal, signal } from "@preact/signals-core";
import { SILENT } from "../decode/liveness";
import { header, shortType } from "./names";
import type { RobotSession } from "./session";

/** Request of a control, each from -1 to 1: forward, left, and turning left. */
export interface Wish {
  forward: number;
  left: number;
  turn: number;
}

/** Speeds at full deflection, in m/s and rad/s. */
export interface SpeedLimits {
  linear: number;
  angular: number;
}

export const NO_WISH: Wish = { forward: 0, left: 0, turn: 0 };
const DRIVE_TYPES = ["geometry_msgs/Twist", "geometry_msgs/TwistStamped"];
/** Milliseconds between two commands while a control is held. */
const PERIOD = 50;
/** Commands to stand still that follow the last one: one of them may be lost. */
const STANDSTILLS = 3;

/** The topics that a robot is driven by, the likeliest first: those that somebody of the robot may hear. */
export function driveTopics(session: RobotSession): string[] {
  const usual = (name: string) =>
    name === "/cmd_vel" ? 0 : name.endsWith("/cmd_vel") ? 1 : /cmd_vel|drive|twist/.test(name) ? 2 : 3;
  return session.topicsOf(...DRIVE_TYPES).sort((one, other) => usual(one) - usual(other));
}

/**
 * Sends the velocity that the controls ask for. Several controls may be held; the one that was taken last counts.
 * When none is held any more, when the page is hidden or loses the keyboard, and when the connection was lost or the
 * robot does not answer, the robot is told to stand still; after that nothing is sent. The same when this page itself
 * was suspended. A control that was held before counts only once it is taken anew.
 */
export class Drive {
  /** The command that was sent last, in m/s and rad/s. */
  readonly sent: Signal<{ linear: number; lateral: number; angular: number }> = signal({
    linear: 0,
    lateral: 0,
    angular: 0,
  });
  readonly moving: Signal<boolean> = signal(false);
  /** True if this page was suspended while a control was held, until one is taken anew. */
  readonly stalled: Signal<boolean> = signal(false);
  limits: SpeedLimits = { linear: 0.5, angular: 1 };

  private readonly held = new Map<string, Wish>();
  private readonly publisher;
  private readonly stamped: boolean;
  private timer: ReturnType<typeof setInterval> | undefined;
  private standstills = 0;
  private sentAt = 0;
  private readonly endWatching: () => void;

  /**
   * @param session the robot
   * @param topic where it hears velocities
   * @param type of the topic, as the robot writes it
   */
  constructor(
    private readonly session: RobotSession,
    topic: string,
    type: string,
  ) {
    this.stamped = shortType(type) === "geometry_msgs/TwistStamped";
    this.publisher = session.commands.publisher(topic, type);
    this.endWatching = effect(() => {
      if (session.commands.block.value) this.lose();
    });
  }

  /** A control is held, and asks for this. */
  hold(control: string, wish: Wish): void {
    this.held.delete(control);
    if (this.session.commands.block.peek()) return;
    this.held.set(control, wish);
    this.stalled.value = false;
    this.standstills = 0;
    this.moving.value = true;
    if (this.timer === undefined) {
      this.sentAt = Date.now();
      this.timer = setInterval(() => this.send(), PERIOD);
      this.send();
    }
  }

  /** Return true if a control counts as held: after a stop or the loss of the connection only once it is taken anew. */
  holds(control: string): boolean {
    return this.held.has(control);
  }

  /** A control was let go. */
  release(control: string): void {
    this.held.delete(control);
    if (this.held.size === 0) this.moving.value = false;
  }

  /** Every control counts as let go. */
  releaseAll(): void {
    this.held.clear();
    this.moving.value = false;
    // At once: a page that is being hidden or closed has no further turn.
    if (this.timer !== undefined) this.publish(NO_WISH);
  }

  /** End; the robot is told to stand still if it moved. */
  dispose(): void {
    this.endWatching();
    this.releaseAll();
    clearInterval(this.timer);
    this.timer = undefined;
    this.publisher.dispose();
  }

  private lose(): void {
    this.held.clear();
    this.moving.value = false;
  }

  private send(): void {
    const now = Date.now();
    // After a pause of the page, be it a busy thread or a closed lid, it is unknown whether the control is still held.
    if (Math.abs(now - this.sentAt) > SILENT) {
      this.stalled.value = this.held.size > 0;
      this.lose();
    }
    this.sentAt = now;
    const wish = [...this.held.values()].at(-1);
    this.publish(wish ?? NO_WISH);
    if (wish) return;
    if (++this.standstills >= STANDSTILLS) {
      clearInterval(this.timer);
      this.timer = undefined;
    }
  }

  private publish({ forward, left, turn }: Wish): void {
    const linear = clamp(forward) * this.limits.linear;
    const lateral = clamp(left) * this.limits.linear;
    const angular = clamp(turn) * this.limits.angular;
    this.sent.value = { linear, lateral, angular };
    const twist = { linear: { x: linear, y: lateral, z: 0 }, angular: { x: 0, y: 0, z: angular } };
    const { version, robotTime } = this.session;
    const message = this.stamped ? { header: header(version.peek(), "base_link", robotTime), twist } : twist;
    if (linear || lateral || angular) this.publisher.publishFresh(message);
    // To stand still is never late.
    else this.publisher.publishZero(message);
  }
}

function clamp(value: number): number {
  return Number.isFinite(value) ? Math.max(-1, Math.min(1, value)) : 0;
}
