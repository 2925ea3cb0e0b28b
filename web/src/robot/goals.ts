/** Goals of actions: by the ops of ROS 2's rosbridge, or by the topics of ROS 1's actionlib. */

import { type Ros, Topic } from "roslib";
import type { Message } from "./subscriptions";

export type GoalOutcome = "succeeded" | "canceled" | "aborted" | "rejected" | "lost";

export interface GoalEnd {
  outcome: GoalOutcome;
  result: Message;
  /** Text of the robot; may be empty. */
  text: string;
}

export interface GoalOptions {
  onFeedback?: (feedback: Message) => void;
}

export interface GoalHandle {
  /** Comes when the goal has ended, however it did. */
  outcome: Promise<GoalEnd>;
  /** Ask the robot to give it up. */
  cancel(): void;
  /** Wait no longer. */
  abandon(text: string): void;
}

/** By the constants of action_msgs/GoalStatus. */
const STATUS_2: Record<number, GoalOutcome> = { 4: "succeeded", 5: "canceled", 6: "aborted" };
/** By the constants of actionlib_msgs/GoalStatus; those that are left out are not the end. */
const STATUS_1: Record<number, GoalOutcome> = {
  2: "canceled",
  3: "succeeded",
  4: "aborted",
  5: "rejected",
  8: "canceled",
  9: "lost",
};

/** Send a goal; `version` is the robot's generation of ROS. */
export function sendGoal(
  ros: Ros,
  version: 1 | 2,
  action: string,
  type: string,
  goal: Message,
  options: GoalOptions,
): GoalHandle {
  return version === 2
    ? sendByOps(ros, action, type, goal, options)
    : sendByTopics(ros, action, type, goal, options);
}

interface ActionEvent {
  op: string;
  values?: Message | string;
  status?: number;
  result?: boolean;
  reason?: string;
}

function newId(action: string): string {
  return `send_action_goal:${action}:${crypto.getRandomValues(new Uint32Array(2)).join("-")}`;
}

function sendByOps(ros: Ros, action: string, type: string, goal: Message, options: GoalOptions): GoalHandle {
  const id = newId(action);
  const { promise, resolve } = withResolvers<GoalEnd>();
  const hear = (event: unknown) => {
    const { op, values, status, result, reason } = event as ActionEvent;
    if (op === "action_feedback") options.onFeedback?.((values as Message) ?? {});
    if (op !== "action_result") return;
    ros.off(id, hear as never);
    const outcome = STATUS_2[status ?? 0] ?? (result ? "succeeded" : "rejected");
    const isText = typeof values === "string";
    resolve({ outcome, result: isText || !values ? {} : values, text: isText ? values : (reason ?? "") });
  };
  ros.on(id, hear as never);
  ros.callOnConnection({
    op: "send_action_goal",
    id,
    action,
    action_type: type,
    args: goal,
    feedback: true,
  } as never);
  return {
    outcome: promise,
    cancel: () => ros.callOnConnection({ op: "cancel_action_goal", id, action } as never),
    abandon: (text) => {
      ros.off(id, hear as never);
      resolve({ outcome: "lost", result: {}, text });
    },
  };
}

interface GoalStatus {
  goal_id: { id: string };
  status: number;
  text: string;
}

function sendByTopics(
  ros: Ros,
  action: string,
  type: string,
  goal: Message,
  options: GoalOptions,
): GoalHandle {
  const id = newId(action);
  const bare = type.replace(/Action$/, "");
  const topic = (part: string, messageType: string) =>
    new Topic<Message>({ ros, name: `${action}/${part}`, messageType });
  const goals = topic("goal", `${bare}ActionGoal`);
  const cancels = topic("cancel", "actionlib_msgs/GoalID");
  const feedbacks = topic("feedback", `${bare}ActionFeedback`);
  const results = topic("result", `${bare}ActionResult`);
  const { promise, resolve } = withResolvers<GoalEnd>();
  const end = (last: GoalEnd) => {
    for (const each of [feedbacks, results]) each.unsubscribe();
    for (const each of [goals, cancels]) each.unadvertise();
    resolve(last);
  };
  const status = (message: Message) => message.status as GoalStatus | undefined;
  feedbacks.subscribe((message) => {
    if (status(message)?.goal_id.id === id) options.onFeedback?.(message.feedback as Message);
  });
  results.subscribe((message) => {
    const said = status(message);
    if (said?.goal_id.id !== id) return;
    end({
      outcome: STATUS_1[said.status] ?? "lost",
      result: (message.result as Message) ?? {},
      text: said.text,
    });
  });
  goals.advertise();
  cancels.advertise();
  const stamp = { secs: 0, nsecs: 0 };
  goals.publish({ header: { stamp, frame_id: "" }, goal_id: { stamp, id }, goal });
  return {
    outcome: promise,
    cancel: () => cancels.publish({ stamp, id }),
    abandon: (text) => end({ outcome: "lost", result: {}, text }),
  };
}

/** `Promise.withResolvers`, which not every browser in use has. */
function withResolvers<T>(): { promise: Promise<T>; resolve: (value: T) => void } {
  let resolve: (value: T) => void = () => undefined;
  const promise = new Promise<T>((fulfil) => {
    resolve = fulfil;
  });
  return { promise, resolve };
}
