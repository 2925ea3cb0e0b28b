/** Sending a robot somewhere, by an action where it has one, else by a topic; and telling it where it is. */

import { type Signal, signal } from "@preact/signals-core";
import type { RobotPublisher } from "./commands";
import type { GoalHandle, GoalOutcome } from "./goals";
import { header, seconds } from "./names";
import type { RobotSession } from "./session";
import type { Message } from "./subscriptions";

/** A place on the ground, in metres, with a direction in radians. */
export interface Place {
  x: number;
  y: number;
  yaw: number;
}

/** State of a goal. */
export interface Progress {
  place: Place;
  frame: string;
  /** Metres that are left, where the robot says so. */
  distance: number;
  /** Seconds that are left, where the robot says so. */
  remaining: number;
  /** null while it is under way. */
  outcome: GoalOutcome | "sent" | null;
  text: string;
}

/** Actions that go somewhere, by the end of their names, and the field of their goal that is the place. */
const ACTIONS = { "/navigate_to_pose": "pose", "/move_base": "target_pose" } as const;
const ACTION_TYPES = {
  pose: "nav2_msgs/action/NavigateToPose",
  target_pose: "move_base_msgs/action/MoveBase",
} as const;
const GOAL_TOPICS = ["/goal_pose", "/move_base_simple/goal"];
const POSE_TOPIC = "/initialpose";
const POINT_TOPIC = "/clicked_point";

/** A place to go to after others, and the frame that it is in. */
export interface Waypoint {
  place: Place;
  frame: string;
}

/** End of a goal for the page; `sent` without a way to know more, `replaced` by a later goal. */
export type SendOutcome = GoalOutcome | "sent" | "replaced" | "blocked";

export class Navigation {
  /** The last goal of this page; null before the first. */
  readonly progress: Signal<Progress | null> = signal(null);
  /** A position that is being chosen, for the views that can show it. */
  readonly draft: Signal<{ place: Place; frame: string } | null> = signal(null);
  /** Index of the waypoint that the robot is sent to; -1 while it follows none. */
  readonly waypoint = signal(-1);
  private goal: GoalHandle | null = null;
  private points: RobotPublisher | null = null;

  constructor(private readonly session: RobotSession) {}

  /** By which action or topic a goal would be sent; null where there is none that this client may use. */
  get way():
    | { kind: "action"; name: string; field: "pose" | "target_pose" }
    | { kind: "topic"; name: string }
    | null {
    const { session } = this;
    for (const [end, field] of Object.entries(ACTIONS)) {
      const name = session.graph.value.actions.find(
        (each) => each.endsWith(end) && session.may("goals", each),
      );
      if (name) return { kind: "action", name, field };
    }
    const poses = session.topicsOf("geometry_msgs/PoseStamped");
    const topic = GOAL_TOPICS.find((name) => poses.includes(name) && session.may("publish", name));
    return topic ? { kind: "topic", name: topic } : null;
  }

  /** True if the robot accepts an initial pose. */
  get takesPose(): boolean {
    return this.session.graph.value.topics.has(POSE_TOPIC) && this.session.may("publish", POSE_TOPIC);
  }

  /**
   * Send the robot to waypoints one after the other. Anything but success ends it: a stop, a cancellation, another goal, a lost
   * connection.
   */
  async follow(waypoints: readonly Waypoint[]): Promise<void> {
    if (this.waypoint.peek() >= 0) return;
    for (const [at, { place, frame }] of waypoints.entries()) {
      this.waypoint.value = at;
      if ((await this.send(place, frame)) !== "succeeded") break;
    }
    this.waypoint.value = -1;
  }

  /** True if the robot is told of a point that was clicked. */
  get takesPoint(): boolean {
    return this.session.may("publish", POINT_TOPIC);
  }

  /** Publish a point, as RViz does. */
  publishPoint({ x, y }: Place, frame: string): void {
    // Kept: programs on the robot would not know a publisher in time that goes at once.
    this.points ??= this.session.commands.publisher(POINT_TOPIC, "geometry_msgs/PointStamped");
    this.points.publish({ header: header(this.session.version.peek(), frame), point: { x, y, z: 0 } });
  }

  /** Send the robot to a place of a frame; the promise comes when it has ended. */
  async send(place: Place, frame: string): Promise<SendOutcome> {
    const { session, way } = this;
    if (!way) return "blocked";
    const { commands } = session;
    if (!commands.mayCommand(way.name, way.kind === "topic" ? "publish" : "goals")) return "blocked";
    const pose = this.stamped(place, frame);
    this.progress.value = {
      place,
      frame,
      distance: Number.NaN,
      remaining: Number.NaN,
      outcome: way.kind === "topic" ? "sent" : null,
      text: "",
    };
    if (way.kind === "topic") {
      const publisher = commands.publisher(way.name, session.graph.peek().topics.get(way.name) ?? "");
      publisher.publish(pose);
      publisher.dispose();
      return "sent";
    }
    // actionlib has no types of actions: they are those of its topics.
    const goalType = session.graph.peek().topics.get(`${way.name}/goal`) ?? "";
    const type =
      session.version.peek() === 2 ? ACTION_TYPES[way.field] : goalType.replace(/ActionGoal$/, "Action");
    const goal = commands.sendGoal(
      way.name,
      type,
      { [way.field]: pose },
      { onFeedback: (feedback) => this.update(goal, feedback) },
    );
    this.goal = goal;
    const { outcome, text, result } = await goal.outcome;
    if (this.goal !== goal) return "replaced";
    this.goal = null;
    const { progress } = this;
    const said = text || String(result.error_msg ?? "");
    if (progress.value) progress.value = { ...progress.value, outcome, text: said };
    return outcome;
  }

  /** Ask the robot to give up its goal. */
  cancel(): void {
    this.goal?.cancel();
  }

  /** Tell the robot where it is. */
  setPose(place: Place, frame: string): void {
    const { session } = this;
    const publisher = session.commands.publisher(
      POSE_TOPIC,
      session.graph.peek().topics.get(POSE_TOPIC) ?? "",
    );
    const { header: head, pose } = this.stamped(place, frame);
    // Half a metre and 15 degrees, as rviz says of a place that is pointed at.
    const covariance = new Array<number>(36).fill(0);
    covariance[0] = covariance[7] = 0.25;
    covariance[35] = (Math.PI / 12) ** 2;
    publisher.publish({ header: head, pose: { pose, covariance } });
    publisher.dispose();
  }

  private stamped({ x, y, yaw }: Place, frame: string): Message {
    return {
      header: header(this.session.version.peek(), frame),
      pose: {
        position: { x, y, z: 0 },
        orientation: { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) },
      },
    };
  }

  private update(goal: GoalHandle, feedback: Message): void {
    const { progress } = this;
    if (this.goal !== goal || !progress.value) return;
    progress.value = {
      ...progress.value,
      distance: Number(feedback.distance_remaining),
      remaining: seconds(feedback.estimated_time_remaining),
    };
  }
}
