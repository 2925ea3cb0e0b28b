import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import type { FromWorker, ToWorker } from "../src/decode/protocol";
import { Drive } from "../src/robot/drive";
import { RobotSession } from "../src/robot/session";
import { Stop } from "../src/robot/stop";
import type { WorkerPort } from "../src/robot/transport";

type Op = { op: string; id?: string; topic?: string; msg?: unknown; service?: string; type?: string };

/** A robot in the place of the worker. */
class FakeRobot implements WorkerPort {
  onmessage: WorkerPort["onmessage"] = null;
  sent: Op[] = [];
  socket = 0;
  opens: ToWorker[] = [];
  topics: [string, string][] = [["/cmd_vel", "geometry_msgs/msg/Twist"]];
  services: string[] = [];
  answers: Record<string, unknown> = {};

  postMessage(message: ToWorker): void {
    if (message.kind === "open") {
      this.socket = message.socket;
      this.opens.push(message);
    } else if (message.kind === "send") {
      const op = JSON.parse(message.text) as Op;
      this.sent.push(op);
      if (op.op === "call_service") this.answer(op);
    }
  }

  say(message: FromWorker): void {
    this.onmessage?.({ data: message } as MessageEvent<FromWorker>);
  }

  hear(message: object): void {
    this.say({ kind: "message", socket: this.socket, message: message as { op: string }, mustTake: false });
  }

  open(): void {
    this.say({ kind: "open", socket: this.socket });
  }

  lose(): void {
    this.say({ kind: "close", socket: this.socket, code: 1006, reason: "" });
  }

  private answer({ id, service }: Op): void {
    const values = {
      "/rosapi/topics": {
        topics: this.topics.map(([name]) => name),
        types: this.topics.map(([, type]) => type),
      },
      "/rosapi/services": { services: this.services },
      ...this.answers,
      "/rosapi/action_servers": { action_servers: ["/go"] },
      "/rosapi/nodes": { nodes: [] },
      "/rosapi/get_ros_version": { version: 2, distro: "jazzy" },
    }[service ?? ""];
    if (values)
      queueMicrotask(() => this.hear({ op: "service_response", id, service, values, result: true }));
  }

  published(topic: string): unknown[] {
    return this.sent.filter((op) => op.op === "publish" && op.topic === topic).map((op) => op.msg);
  }

  ops(op: string): Op[] {
    return this.sent.filter((each) => each.op === op);
  }
}

const twist = (x: number, turn: number) => ({
  linear: { x, y: 0, z: 0 },
  angular: { x: 0, y: 0, z: turn },
});

describe("a session", () => {
  let robot: FakeRobot;
  let session: RobotSession;

  beforeEach(async () => {
    vi.useFakeTimers();
    vi.stubGlobal("fetch", () => Promise.reject(new Error("no HTTP here")));
    robot = new FakeRobot();
    session = new RobotSession({ url: "ws://robot:9090", token: "secret", worker: robot });
    await vi.advanceTimersByTimeAsync(0);
    robot.open();
    await vi.advanceTimersByTimeAsync(0);
  });

  afterEach(() => {
    session.close();
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });

  test("shows its token in a subprotocol, never in the address", () => {
    expect(robot.opens).toEqual([
      { kind: "open", socket: 1, url: "ws://robot:9090", protocols: ["rwt", "bearer.secret"] },
    ]);
  });

  test("knows what the robot offers, and its generation", () => {
    expect(session.topicsOf("geometry_msgs/Twist")).toEqual(["/cmd_vel"]);
    expect(session.version.value).toBe(2);
    expect(session.distro.value).toBe("jazzy");
  });

  test("subscribes once for several listeners, as often as the most demanding wants", async () => {
    const heard: unknown[] = [];
    const slow = session.subscribe("/odom", "nav_msgs/msg/Odometry", () => {}, { throttle: 500 });
    session.subscribe("/odom", "nav_msgs/msg/Odometry", (message) => heard.push(message), { throttle: 100 });
    expect(robot.ops("subscribe").map((op) => (op as { throttle_rate?: number }).throttle_rate)).toEqual([
      500, 100,
    ]);
    expect(robot.ops("unsubscribe").map(({ id }) => id)).toEqual([robot.ops("subscribe")[0]?.id]);
    robot.hear({ op: "publish", topic: "/odom", msg: { a: 1 } });
    expect(heard).toEqual([{ a: 1 }]);
    slow();
    expect(robot.ops("subscribe")).toHaveLength(2);
  });

  test("gives the last message to a listener that comes later", async () => {
    session.subscribe("/map", "nav_msgs/msg/OccupancyGrid", () => {});
    robot.hear({ op: "publish", topic: "/map", msg: { latched: true } });
    const heard: unknown[] = [];
    session.subscribe("/map", "nav_msgs/msg/OccupancyGrid", (message) => heard.push(message));
    await vi.advanceTimersByTimeAsync(0);
    expect(heard).toEqual([{ latched: true }]);
  });

  test("connects again by itself and subscribes and advertises as before", async () => {
    session.subscribe("/odom", "nav_msgs/msg/Odometry", () => {});
    session.publisher("/cmd_vel", "geometry_msgs/msg/Twist");
    robot.lose();
    expect(session.state.value).toBe("lost");
    robot.sent = [];
    await vi.advanceTimersByTimeAsync(300);
    robot.lose();
    await vi.advanceTimersByTimeAsync(600);
    robot.open();
    expect(session.state.value).toBe("open");
    expect(robot.opens).toHaveLength(3);
    expect(robot.ops("subscribe").map(({ topic }) => topic)).toEqual(["/odom"]);
    expect(robot.ops("advertise").map(({ topic }) => topic)).toEqual(["/cmd_vel"]);
  });

  test("a call that is not answered is given up, and one under way when the connection goes", async () => {
    const patient = expect(session.call("/silent", {}, "", 1000)).rejects.toThrow(
      "/silent does not answer for 1 s",
    );
    await vi.advanceTimersByTimeAsync(1000);
    await patient;
    const lost = expect(session.call("/silent", {})).rejects.toThrow("the connection was lost");
    robot.lose();
    await lost;
    await expect(session.call("/silent", {})).rejects.toThrow("there is no connection");
  });

  test("a goal comes to its end with feedback", async () => {
    const feedback: unknown[] = [];
    const goal = session.sendGoal(
      "/go",
      "demo/action/Go",
      { to: 1 },
      { onFeedback: (each) => feedback.push(each) },
    );
    const id = robot.ops("send_action_goal")[0]?.id;
    robot.hear({ op: "action_feedback", id, action: "/go", values: { left: 3 } });
    goal.cancel();
    expect(robot.ops("cancel_action_goal")[0]?.id).toBe(id);
    robot.hear({ op: "action_result", id, action: "/go", values: { at: 2 }, status: 5, result: true });
    expect(await goal.outcome).toEqual({ outcome: "canceled", result: { at: 2 }, text: "" });
    expect(feedback).toEqual([{ left: 3 }]);
  });

  test("what the server says of an op is a notice about its topic", () => {
    robot.hear({ op: "status", level: "error", msg: "role 'viewer' may not", id: "publish:/cmd_vel:1" });
    expect(session.notices.value).toEqual([
      { number: 1, level: "error", text: "role 'viewer' may not", about: "/cmd_vel" },
    ]);
  });

  describe("driving", () => {
    let stop: Stop;
    let drive: Drive;

    beforeEach(() => {
      stop = new Stop(session);
      drive = new Drive(session, "/cmd_vel", "geometry_msgs/msg/Twist", stop.stopped);
      drive.limits = { linear: 0.5, angular: 1 };
    });

    test("sends nothing unless a control is held", async () => {
      await vi.advanceTimersByTimeAsync(2000);
      expect(robot.published("/cmd_vel")).toEqual([]);
    });

    test("sends while a control is held, then stands still, then sends nothing", async () => {
      drive.hold("stick", { forward: 1, left: 0, turn: -0.5 });
      await vi.advanceTimersByTimeAsync(100);
      expect(robot.published("/cmd_vel")).toEqual([twist(0.5, -0.5), twist(0.5, -0.5), twist(0.5, -0.5)]);
      drive.release("stick");
      robot.sent = [];
      await vi.advanceTimersByTimeAsync(5000);
      expect(robot.published("/cmd_vel")).toEqual([twist(0, 0), twist(0, 0), twist(0, 0)]);
    });

    test("stands still at once when all is let go", () => {
      drive.hold("keys", { forward: 1, left: 0, turn: 0 });
      robot.sent = [];
      drive.releaseAll();
      expect(robot.published("/cmd_vel")).toEqual([twist(0, 0)]);
    });

    test("wishes beyond full deflection, and those that are no number, are bounded", () => {
      drive.hold("pad", { forward: 7, left: 0, turn: Number.NaN });
      expect(robot.published("/cmd_vel")).toEqual([twist(0.5, 0)]);
    });

    test("a lost connection lets all go: nothing moves when it is back", async () => {
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      robot.lose();
      await vi.advanceTimersByTimeAsync(260);
      robot.open();
      robot.sent = [];
      await vi.advanceTimersByTimeAsync(1000);
      for (const message of robot.published("/cmd_vel")) expect(message).toEqual(twist(0, 0));
    });

    test("a stop is latched: it repeats its command, cancels goals, and holds until released", async () => {
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      robot.sent = [];
      stop.stop();
      await vi.advanceTimersByTimeAsync(1500);
      const sent = robot.published("/cmd_vel");
      expect(sent.length).toBeGreaterThan(9);
      for (const message of sent) expect(message).toEqual(twist(0, 0));
      expect(robot.ops("call_service").map(({ service }) => service)).toContain("/go/_action/cancel_goal");
      robot.sent = [];
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      await vi.advanceTimersByTimeAsync(1000);
      expect(robot.published("/cmd_vel")).toEqual([]);
      stop.release();
      await vi.advanceTimersByTimeAsync(1000);
      expect(robot.published("/cmd_vel")).toEqual([]);
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      expect(robot.published("/cmd_vel")).toEqual([twist(0.5, 0)]);
    });

    describe("at a robot with a gate", () => {
      const gate = (topic: string, msg: object) => robot.hear({ op: "publish", topic, msg });
      const called = () => robot.ops("call_service").map(({ service }) => service);

      beforeEach(async () => {
        robot.services = ["/gate/stop"];
        robot.answers = {
          "/gate/stop": { success: true, message: "stopped" },
          "/gate/release_stop": { success: false, message: "role 'operator' may not release the robot" },
          "/gate/release_lease": { success: false, message: "held by another" },
        };
        await vi.advanceTimersByTimeAsync(4000);
        robot.sent = [];
      });

      test("the stop is pressed there, and holds for every page until the robot says otherwise", async () => {
        stop.stop();
        await vi.advanceTimersByTimeAsync(1500);
        expect(called()).toContain("/gate/stop");
        expect(robot.published("/cmd_vel")).toEqual([]);
        gate("/gate/stopped", { stopped: true, by: "rosbridge:1 (role operator)", reason: "" });
        stop.release();
        await vi.advanceTimersByTimeAsync(10);
        expect(called()).toContain("/gate/release_stop");
        expect(stop.stopped.value).toBe(true);
        expect(session.notices.value.at(-1)?.text).toContain("may not release the robot");
        gate("/gate/stopped", { stopped: false, by: "rosbridge:2 (role admin)", reason: "" });
        expect(stop.stopped.value).toBe(false);
      });

      test("a gate that does not answer leaves the robot to the page", async () => {
        robot.answers["/gate/stop"] = { success: false, message: "no rule says what there is to stop" };
        stop.stop();
        await vi.advanceTimersByTimeAsync(1500);
        expect(robot.published("/cmd_vel").length).toBeGreaterThan(9);
        expect(stop.stopped.value).toBe(true);
      });

      test("it is shown who drives, and the lease is given back when somebody has it", async () => {
        stop.gate.giveBack("/cmd_vel");
        expect(called()).not.toContain("/gate/release_lease");
        gate("/gate/leases", { leases: [{ topic: "/cmd_vel", holder: "rosbridge:1", role: "operator" }] });
        expect(stop.gate.holders.value.get("/cmd_vel")).toEqual({ name: "rosbridge:1", role: "operator" });
        stop.gate.giveBack("/cmd_vel");
        expect(called()).toContain("/gate/release_lease");
      });
    });
  });
});
