// @vitest-environment happy-dom

import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import type { Container, Ros } from "../../src/dropin/globals";
import {
  ImageMapClientNav,
  Navigator,
  type NavigatorOptions,
  OccupancyGridClientNav,
} from "../../src/dropin/nav2d";
import {
  FakeContainer,
  type FakeMarker,
  FakeRos,
  FakeStage,
  goals,
  installRos2d,
  installRoslib,
  subscriptions,
} from "./fakes";

let ros: FakeRos;
let stage: FakeStage;
let made: ReturnType<typeof installRos2d>;

function start(version: 1 | 2): void {
  installRoslib(version);
  made = installRos2d();
  ros = new FakeRos();
  stage = new FakeStage();
}

function options(more: Partial<NavigatorOptions> = {}): NavigatorOptions {
  return { ros: ros as unknown as Ros, rootObject: stage as unknown as Container, ...more };
}

const viewer = { scaleToDimensions: vi.fn(), shift: vi.fn() };
const markers = () => stage.children as FakeMarker[];
/** The way to send goals is known after the robot was asked for its version. */
const settled = () => new Promise((resolve) => setTimeout(resolve));

beforeEach(() => start(1));
afterEach(() => {
  vi.unstubAllGlobals();
  vi.clearAllMocks();
});

describe("goals", () => {
  test("a double click sends move_base there on ROS 1, and marks the place until the goal has ended", async () => {
    Navigator(options());
    stage.emit("dblclick", { stageX: 2, stageY: -3 });
    await settled();
    expect(goals[0]?.send).toHaveBeenCalledOnce();
    expect(goals[0]?.options).toMatchObject({
      actionClient: { options: { serverName: "/move_base", actionName: "move_base_msgs/MoveBaseAction" } },
      goalMessage: {
        target_pose: {
          header: { frame_id: "map" },
          pose: { position: { x: 2, y: 3, z: 0 }, orientation: { x: 0, y: 0, z: 0, w: 1 } },
        },
      },
    });
    expect(markers()).toHaveLength(2);
    expect(markers()[1]).toMatchObject({ x: 2, y: -3 });
    goals[0]?.emit("result", {});
    expect(markers()).toHaveLength(1);
  });

  test("a second goal is marked too, and the end of the first does not take its mark", async () => {
    Navigator(options());
    stage.emit("dblclick", { stageX: 1, stageY: 1 });
    stage.emit("dblclick", { stageX: 5, stageY: 1 });
    await settled();
    goals[0]?.emit("result", {});
    expect(markers().map(({ x }) => x)).toEqual([undefined, 5]);
  });

  test("a drag says where to look", async () => {
    Navigator(options({ withOrientation: true, serverName: "/pr2_move_base" }));
    stage.emit("dblclick", { stageX: 1, stageY: 1 });
    stage.emit("stagemousedown", { stageX: 1, stageY: -1 });
    stage.emit("stagemousemove", { stageX: 1, stageY: -2 });
    expect(markers()).toHaveLength(2);
    stage.emit("stagemouseup", { stageX: 1, stageY: -2 });
    await settled();
    expect(goals).toHaveLength(1);
    expect(goals[0]?.options.goalMessage).toMatchObject({
      target_pose: {
        pose: {
          position: { x: 1, y: 1, z: 0 },
          orientation: { x: 0, y: 0, z: Math.sin(Math.PI / 4), w: Math.cos(Math.PI / 4) },
        },
      },
    });
    expect(markers()[1]?.rotation).toBeCloseTo(-90);
  });

  test("is canceled, also before it was sent", async () => {
    const nav = Navigator(options());
    nav.cancelGoal();
    stage.emit("dblclick", { stageX: 1, stageY: 1 });
    nav.cancelGoal();
    await settled();
    expect(goals).toHaveLength(0);
    expect(markers()).toHaveLength(1);
    stage.emit("dblclick", { stageX: 1, stageY: 1 });
    await settled();
    nav.cancelGoal();
    expect(goals[0]?.cancel).toHaveBeenCalledOnce();
  });

  test("goes to Nav2 as an action on ROS 2, with roslib 1", async () => {
    start(2);
    const nav = Navigator(options());
    stage.emit("dblclick", { stageX: 2, stageY: 0 });
    await settled();
    const [sent] = ros.sent;
    expect(sent).toMatchObject({
      op: "send_action_goal",
      action: "/navigate_to_pose",
      action_type: "nav2_msgs/action/NavigateToPose",
      args: { pose: { header: { frame_id: "map" }, pose: { position: { x: 2, y: -0, z: 0 } } } },
    });
    nav.cancelGoal();
    expect(ros.sent[1]).toMatchObject({
      op: "cancel_action_goal",
      id: sent?.id,
      action: "/navigate_to_pose",
    });
    ros.receive({ op: "action_result", id: "another", values: {} });
    expect(markers()).toHaveLength(2);
    ros.receive({ op: "action_result", id: sent?.id, values: {} });
    expect(markers()).toHaveLength(1);
  });

  test("goes to Nav2 through ROSLIB.Action where there is one", async () => {
    start(2);
    const sendGoal = vi.fn(() => "7");
    const cancelGoal = vi.fn();
    const constructed = vi.fn();
    class Action {
      sendGoal = sendGoal;
      cancelGoal = cancelGoal;
      constructor(given: object) {
        constructed(given);
      }
    }
    Object.assign((globalThis as unknown as { ROSLIB: object }).ROSLIB, { Action });
    const nav = Navigator(options({ serverName: "/go", actionName: "nav2_msgs/NavigateToPose" }));
    stage.emit("dblclick", { stageX: 2, stageY: 0 });
    await settled();
    expect(constructed).toHaveBeenCalledWith({ ros, name: "/go", actionType: "nav2_msgs/NavigateToPose" });
    expect(sendGoal).toHaveBeenCalledOnce();
    nav.cancelGoal();
    expect(cancelGoal).toHaveBeenCalledWith("7");
  });
});

describe("the robot", () => {
  const half = { x: 0, y: 0, z: 1, w: 0 };

  test("is shown from when its pose is known, as large as before at every scale", () => {
    const nav = Navigator(options());
    const [robot] = markers();
    expect(robot).toMatchObject({ kind: "arrow", visible: false, scaleX: 1 });
    stage.scaleX = stage.scaleY = 50;
    subscriptions.get("/robot_pose")?.({ position: { x: 1, y: 2, z: 0 }, orientation: half });
    expect(robot).toMatchObject({ x: 1, y: -2, visible: true, scaleX: 1 / 50 });
    stage.scaleX = stage.scaleY = 100;
    nav.rescale();
    expect(robot?.scaleX).toBe(1 / 100);
    robot?.emit("tick");
    expect(robot?.scaleX).toBeGreaterThanOrEqual(1 / 100);
    expect(robot?.scaleX).toBeLessThanOrEqual(1.4 / 100);
  });

  test("is found by tf where a client for that is given", () => {
    const subscribe = vi.fn();
    Navigator(options({ tfClient: { subscribe }, robot_pose: "base_link" }));
    expect(subscribe.mock.calls[0]?.[0]).toBe("base_link");
    subscribe.mock.calls[0]?.[1]({ translation: { x: 3, y: 4, z: 0 }, rotation: half });
    expect(markers()[0]).toMatchObject({ x: 3, y: -4, visible: true });
  });

  test("is a picture where one is given", () => {
    Navigator(options({ image: "turtlebot.png" }));
    expect(markers()[0]).toMatchObject({ kind: "image", options: { image: "turtlebot.png" } });
  });
});

describe("maps", () => {
  const grid = (x: number) => ({ width: 10, height: 8, pose: { position: { x, y: -4 } } });

  test.each([
    [
      "as a constructor",
      () => new (OccupancyGridClientNav as never as new (given: object) => object)({ ...options(), viewer }),
    ],
    [
      "as a function",
      () => OccupancyGridClientNav({ ...options(), viewer, continuous: true, topic: "/slam" }),
    ],
  ])("OccupancyGridClientNav %s shows all of the map", (_, make) => {
    const nav = make();
    expect(nav).toBeInstanceOf(OccupancyGridClientNav);
    const [client] = made.maps;
    Object.assign(client as object, { currentGrid: grid(-5) });
    client?.emit("change");
    client?.emit("change");
    expect(viewer.scaleToDimensions.mock.calls).toEqual([[10, 8]]);
    expect(viewer.shift.mock.calls).toEqual([[-5, -4]]);
    Object.assign(client as object, { currentGrid: grid(-6) });
    client?.emit("change");
    expect(viewer.shift.mock.calls.at(-1)).toEqual([-6, -4]);
  });

  test("ImageMapClientNav takes the picture of the map from `image_map`, or else from `image`", () => {
    ImageMapClientNav({ ...options(), viewer, image_map: "map.png", image: "robot.png" });
    ImageMapClientNav({ ...options(), viewer, image: "map.png" });
    expect(made.options).toMatchObject([
      { topic: "/map_metadata", image: "map.png" },
      { topic: "/map_metadata", image: "map.png" },
    ]);
    expect(markers().map(({ kind }) => kind)).toEqual(["image", "arrow"]);
    Object.assign(made.maps[0] as object, { currentImage: grid(0) });
    made.maps[0]?.emit("change");
    expect(viewer.scaleToDimensions).toHaveBeenCalledWith(10, 8);
  });

  test("a rootObject that is on no stage is refused in words", () => {
    expect(() => Navigator(options({ rootObject: new FakeContainer() as never }))).toThrow(
      "rootObject is on no stage",
    );
  });
});
