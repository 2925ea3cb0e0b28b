/**
 * The stop that everybody sees: a latched software stop. It is no emergency stop; that one cuts the power.
 *
 * Where the robot has a gate, its stop is pressed, which holds for every client; elsewhere this page sends what makes
 * the robot stand, and blocks every other command. A stop that is pressed without a connection is sent first after the
 * next one is made.
 */

import { computed, effect, type ReadonlySignal, type Signal, signal, untracked } from "@preact/signals-core";
import { driveTopics } from "./drive";
import { Gate } from "./gate";
import { HOLD, TRAJECTORY, trajectoryTopics } from "./jog";
import { header, rosTime, shortType } from "./names";
import type { RobotSession } from "./session";

/** Milliseconds for which a stop repeats its command, and between two of them. */
const LASTS = 1000;
const PERIOD = 100;

export class Stop {
  /** True if this page sends nothing that moves the robot. */
  readonly stopped: ReadonlySignal<boolean>;
  readonly gate: Gate;
  private readonly here: Signal<boolean> = signal(false);
  /** Set while a stop waits for a connection. */
  private isPending = false;

  constructor(private readonly session: RobotSession) {
    this.gate = new Gate(session);
    this.stopped = computed(() => this.here.value || this.gate.stop.value.stopped);
    effect(() => {
      session.commands.stopped.value = this.stopped.value;
    });
    effect(() => {
      if (session.state.value === "open" && this.isPending) untracked(() => this.stop());
    });
  }

  /** Targets: topics for driving and for trajectories of joints, and actions whose goals can be cancelled. */
  get reaches(): { topics: string[]; actions: string[] } {
    const { session } = this;
    return {
      topics: [...driveTopics(session), ...trajectoryTopics(session)].filter((name) =>
        session.may("publish", name),
      ),
      actions: session.graph.value.actions.filter((name) => session.may("goals", name)),
    };
  }

  /** Tell the robot to stand still, cancel every goal of every action, and send nothing until `release`. */
  stop(): void {
    this.here.value = true;
    this.isPending = this.session.state.peek() !== "open";
    if (this.isPending) return;
    if (!this.gate.present.peek()) {
      this.tellRobot();
      return;
    }
    this.gate.press().catch((error: Error) => {
      this.session.note("warning", error.message, "/gate/stop");
      // Lost on its way: it is sent again with the next connection.
      this.isPending = this.here.peek() && this.session.state.peek() !== "open";
      this.tellRobot();
    });
  }

  private tellRobot(): void {
    const { topics, actions } = this.reaches;
    for (const topic of topics) this.standStill(topic);
    for (const action of actions) this.cancelGoals(action);
  }

  /** Let the controls of this page work again, and the robot's stop, if the role may; nothing moves by that. */
  release(): void {
    this.here.value = this.isPending = false;
    if (!this.gate.stop.peek().stopped) return;
    this.gate
      .release()
      .catch((error: Error) => this.session.note("error", error.message, "/gate/release_stop"));
  }

  private standStill(topic: string): void {
    const { session } = this;
    const type = session.graph.peek().topics.get(topic) ?? "";
    const publisher = session.commands.publisher(topic, type);
    const zero = { x: 0, y: 0, z: 0 };
    const twist = { linear: zero, angular: zero };
    const standing = {
      "geometry_msgs/TwistStamped": () => ({
        header: header(session.version.peek(), "base_link", session.robotTime),
        twist,
      }),
      [TRAJECTORY]: () => HOLD,
    }[shortType(type)];
    const send = () => publisher.publishZero(standing?.() ?? twist);
    send();
    const timer = setInterval(send, PERIOD);
    setTimeout(() => {
      clearInterval(timer);
      publisher.dispose();
    }, LASTS);
  }

  private cancelGoals(action: string): void {
    const { session } = this;
    const version = session.version.peek();
    const stamp = rosTime(version, 0);
    if (version === 1) {
      // An empty id and a time of zero stand for every goal, in actionlib and in ROS 2 alike.
      const publisher = session.commands.publisher(`${action}/cancel`, "actionlib_msgs/GoalID");
      publisher.publishZero({ stamp, id: "" });
      publisher.dispose();
      return;
    }
    const everyGoal = { goal_info: { goal_id: { uuid: new Array(16).fill(0) }, stamp } };
    session.commands
      .callSafe(`${action}/_action/cancel_goal`, everyGoal, "action_msgs/srv/CancelGoal")
      .catch((error: Error) => session.note("warning", error.message, action));
  }
}
