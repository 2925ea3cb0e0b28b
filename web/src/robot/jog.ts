/** Moving the joints of an arm by hand: small steps towards what the sliders ask for. */

import { effect, type Signal, signal } from "@preact/signals-core";
import { SILENT } from "../decode/liveness";
import { rosTime } from "./names";
import type { RobotSession } from "./session";

export const TRAJECTORY = "trajectory_msgs/JointTrajectory";
/** A trajectory without points: a controller holds the joints where they are. */
export const HOLD = { joint_names: [], points: [] };
/** Milliseconds between two commands, and from a command to its position; the joints stop after that without another. */
const PERIOD = 50;
const HORIZON = 200;
/** Steps of the last position, of which one may be lost, and after which the joints are there: then they are held. */
const REPEATS = 4;
const SETTLED = REPEATS + HORIZON / PERIOD + 1;
/** Pause of the page, in milliseconds, after which the positions are no longer wanted. */
const SUSPENDED = 2000;
/** Distance from the last command at which something else has moved a joint, in radians or metres. */
const MOVED = 0.1;
/** Maximum speed, also of joints whose description states more; that of joints without a description. */
const MOST_SPEED = 2;
const USUAL_SPEED = 1;
/** Joints of a description that are moved. */
const MOST_JOINTS = 100;

/** Joint with its limits, in radians and radians per second; a linear one in metres. */
export interface Joint {
  name: string;
  lower: number;
  upper: number;
  speed: number;
  isLinear: boolean;
}

/** Topics on which a robot hears trajectories of joints. */
export function trajectoryTopics(session: RobotSession): string[] {
  return session.topicsOf(TRAJECTORY);
}

/** The joints of a URDF that have limits of their own: wheels have none, and coupled joints follow others. */
export function jointsOf(urdf: string): Joint[] {
  // The browser's error page, which a text without XML is parsed to, has styles that the page's policy forbids.
  if (!/<robot[\s>]/.test(urdf)) return [];
  const document = new DOMParser().parseFromString(urdf, "application/xml");
  const joints = [...document.querySelectorAll("robot > joint")].flatMap((joint) => {
    const kind = joint.getAttribute("type");
    const limit = joint.querySelector("limit");
    if ((kind !== "revolute" && kind !== "prismatic") || !limit || joint.querySelector("mimic")) return [];
    const number = (name: string) => Number(limit.getAttribute(name) ?? 0);
    const [lower, upper] = [number("lower"), number("upper")];
    if (!(lower < upper) || !Number.isFinite(upper - lower)) return [];
    // A speed below zero would lead away from the position that is asked for.
    const speed = Math.min(Math.abs(number("velocity")) || USUAL_SPEED, MOST_SPEED);
    return [{ name: joint.getAttribute("name") ?? "", lower, upper, speed, isLinear: kind === "prismatic" }];
  });
  return joints.slice(0, MOST_JOINTS);
}

/** Joints of a robot without a description: a turn either way. */
export function undescribed(names: readonly string[]): Joint[] {
  const limits = { lower: -Math.PI, upper: Math.PI, speed: USUAL_SPEED, isLinear: false };
  return names.map((name) => ({ name, ...limits }));
}

/**
 * Sends the positions of all joints of an arm, every 50 ms while one of them has not arrived: each is a step at a
 * limited speed. Then, and after a stop, a lost connection or a suspension of this page, it holds the joints; if that is
 * lost, they stop within 0.2 s. For a gate, it is the release of the control.
 */
export class Jog {
  /** Positions that are asked for, by joint; empty while nothing is commanded. */
  readonly wanted: Signal<ReadonlyMap<string, number>> = signal(new Map());
  /** Share of a joint's maximum speed. */
  share = 0.25;

  private readonly measured = new Map<string, number>();
  /** Shares of their speeds at which joints are pushed; empty unless a gamepad does. */
  private pushed: ReadonlyMap<string, number> = new Map();
  /** Positions of the last command. */
  private readonly sent = new Map<string, number>();
  private readonly publisher;
  private timer: ReturnType<typeof setInterval> | undefined;
  /** Steps since the last position is sent. */
  private settled = 0;
  private sentAt = 0;
  private readonly endWatching: () => void;

  /**
   * @param session the robot
   * @param topic where it hears trajectories
   * @param joints the joints of each trajectory
   */
  constructor(
    private readonly session: RobotSession,
    topic: string,
    private readonly joints: readonly Joint[],
  ) {
    this.publisher = session.commands.publisher(topic, session.graph.peek().topics.get(topic) ?? TRAJECTORY);
    this.endWatching = effect(() => {
      if (session.commands.block.value) this.releaseAll();
    });
  }

  /** The joints are at these positions. */
  measure(positions: ReadonlyMap<string, number>): void {
    for (const [name, position] of positions) this.measured.set(name, position);
  }

  /** Move a joint to a position, within its limits. */
  move(name: string, position: number): void {
    const joint = this.joints.find((each) => each.name === name);
    if (!joint || this.session.commands.block.peek()) return;
    if (this.timer === undefined && !this.begin()) return;
    this.wanted.value = new Map(this.wanted.peek()).set(name, within(joint, position));
    this.settled = 0;
  }

  /** Move joints at shares of their speeds, from -1 to 1, until {@link release}; the sliders' positions are forgotten. */
  push(shares: ReadonlyMap<string, number>): void {
    if (this.session.commands.block.peek()) return;
    if (this.timer === undefined && !this.begin()) return;
    if (this.wanted.peek().size) this.wanted.value = new Map();
    this.pushed = shares;
    this.settled = 0;
  }

  /** Whether joints are pushed. */
  get isPushed(): boolean {
    return this.pushed.size > 0;
  }

  /** Hold the joints if they are pushed. */
  release(): void {
    if (this.isPushed) this.hold();
  }

  /** Hold the joints where they are. */
  hold(): void {
    clearInterval(this.timer);
    this.timer = undefined;
    this.pushed = new Map();
    if (this.wanted.peek().size) this.wanted.value = new Map();
    this.publisher.publishZero(HOLD);
  }

  /** Hold the joints if they move. */
  releaseAll(): void {
    if (this.timer !== undefined) this.hold();
  }

  /** End; moving joints are held. */
  dispose(): void {
    this.endWatching();
    this.releaseAll();
    this.publisher.dispose();
  }

  /** Begin at the last command, which a sagging arm is a little below; joints that were moved since, where they are. */
  private begin(): boolean {
    for (const { name } of this.joints) {
      const here = this.measured.get(name);
      if (here === undefined) return false;
      if (!(Math.abs((this.sent.get(name) ?? Number.NaN) - here) <= MOVED)) this.sent.set(name, here);
    }
    this.sentAt = Date.now();
    this.timer = setInterval(() => this.step(), PERIOD);
    return true;
  }

  private step(): void {
    const now = Date.now();
    const elapsed = Math.abs(now - this.sentAt);
    this.sentAt = now;
    if (elapsed > SUSPENDED) {
      this.hold();
      return;
    }
    // The joints have stopped meanwhile. A gate takes what follows for a new grip, and not for queued commands.
    if (elapsed > SILENT) this.publisher.publishZero(HOLD);
    const wanted = this.wanted.peek();
    let isThere = true;
    for (const joint of this.joints) {
      const { name } = joint;
      const here = this.sent.get(name) as number;
      const most = (joint.speed * this.share * Math.min(elapsed, 2 * PERIOD)) / 1000;
      const push = this.pushed.get(name);
      const there = push === undefined ? (wanted.get(name) ?? here) : within(joint, here + push * most);
      const way = there - here;
      this.sent.set(name, here + Math.max(-most, Math.min(most, way)));
      if (Math.abs(way) > most) isThere = false;
    }
    this.settled = isThere && !this.isPushed ? this.settled + 1 : 0;
    if (this.settled > SETTLED) this.hold();
    else if (this.settled <= REPEATS) this.publish();
  }

  private publish(): void {
    const positions = this.joints.map(({ name }) => this.sent.get(name));
    const time_from_start = rosTime(this.session.version.peek(), HORIZON);
    const joint_names = this.joints.map(({ name }) => name);
    this.publisher.publishFresh({ joint_names, points: [{ positions, time_from_start }] });
  }
}

function within({ lower, upper }: Joint, position: number): number {
  return Math.max(lower, Math.min(upper, position));
}
