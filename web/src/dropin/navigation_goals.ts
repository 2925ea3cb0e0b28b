/** Sends goals to a robot's navigation: `move_base` of ROS 1 over actionlib's topics, Nav2 of ROS 2 as an action. */

import { type Pose, pageGlobal, type Ros } from "./globals";

export interface GoalOptions {
  ros: Ros;
  /** The action's name. */
  serverName?: string | undefined;
  /** Its type, `move_base_msgs/MoveBaseAction` or `nav2_msgs/NavigateToPose`. */
  actionName?: string | undefined;
}

interface RunningGoal {
  cancel(): void;
}

/** `onEnd` is called once the goal has ended, however it did. */
type Send = (pose: Pose, onEnd: () => void) => RunningGoal;

const MAP_FRAME = "map";

function uniqueId(): string {
  return `navigate_${Date.now()}_${Math.random().toString(36).slice(2)}`;
}

function overActionlib(ros: Ros, serverName: string, actionName: string): Send {
  const { ActionClient, Goal } = pageGlobal("ROSLIB");
  const actionClient = new ActionClient({ ros, serverName, actionName });
  return (pose, onEnd) => {
    const goalMessage = { target_pose: { header: { frame_id: MAP_FRAME }, pose } };
    const goal = new Goal({ actionClient, goalMessage });
    goal.on("result", onEnd);
    goal.send();
    return goal;
  };
}

function asAction(ros: Ros, action: string, actionType: string): Send {
  const { Action } = pageGlobal("ROSLIB");
  if (Action !== undefined) {
    const client = new Action({ ros, name: action, actionType });
    return (pose, onEnd) => {
      const id = client.sendGoal(navigateToPose(pose), onEnd, undefined, onEnd) ?? "";
      return { cancel: () => client.cancelGoal(id) };
    };
  }
  // roslib 1 knows no actions of ROS 2, but sends every operation, and leaves its socket to be listened to.
  return (pose, onEnd) => {
    const id = uniqueId();
    const socket = ros.socket;
    const listen = (event: Event) => {
      const { data } = event as MessageEvent<unknown>;
      if (typeof data !== "string" || !data.includes(id)) return;
      const message = JSON.parse(data) as { op: string; id?: string };
      if (message.op === "action_result" && message.id === id) {
        socket?.removeEventListener("message", listen);
        onEnd();
      }
    };
    socket?.addEventListener("message", listen);
    const args = navigateToPose(pose);
    ros.callOnConnection({
      op: "send_action_goal",
      id,
      action,
      action_type: actionType,
      args,
      feedback: false,
    });
    return { cancel: () => ros.callOnConnection({ op: "cancel_action_goal", id, action }) };
  };
}

function navigateToPose(pose: Pose): object {
  return { pose: { header: { frame_id: MAP_FRAME }, pose }, behavior_tree: "" };
}

/** Return true if a robot speaks ROS 2: only there rosapi has this service. */
function speaksRos2(ros: Ros): Promise<boolean> {
  const service = new (pageGlobal("ROSLIB").Service)({
    ros,
    name: "/rosapi/get_ros_version",
    serviceType: "rosapi/GetROSVersion",
  });
  return new Promise((resolve) => {
    service.callService(
      {},
      (answer: { version: number }) => resolve(answer.version === 2),
      () => resolve(false),
    );
  });
}

async function chooseWay({ ros, serverName, actionName }: GoalOptions): Promise<Send> {
  const isAction =
    actionName === undefined ? await speaksRos2(ros) : !(actionName.endsWith("Action") || actionName === "");
  return isAction
    ? asAction(ros, serverName ?? "/navigate_to_pose", actionName ?? "nav2_msgs/action/NavigateToPose")
    : overActionlib(ros, serverName ?? "/move_base", actionName || "move_base_msgs/MoveBaseAction");
}

/** A robot's navigation, as its user gives it one goal after another. */
export class NavigationGoals {
  readonly #way: Promise<Send>;
  #current: { goal?: RunningGoal; canceled: boolean } | undefined;

  constructor(options: GoalOptions) {
    this.#way = chooseWay(options);
  }

  /** Sends a goal, which replaces the one before; `onEnd` is called when it has ended and none has replaced it. */
  send(pose: Pose, onEnd: () => void): void {
    const task: { goal?: RunningGoal; canceled: boolean } = { canceled: false };
    this.#current = task;
    const end = () => {
      if (this.#current !== task) return;
      this.#current = undefined;
      onEnd();
    };
    void this.#way.then((send) => {
      if (task.canceled) end();
      else task.goal = send(pose, end);
    });
  }

  /** Cancels the goal under way. */
  cancel(): void {
    if (this.#current === undefined) return;
    this.#current.canceled = true;
    this.#current.goal?.cancel();
  }
}
