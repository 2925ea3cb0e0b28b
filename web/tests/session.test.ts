import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import type { FromWorker, ToWorker } from "../src/decode/protocol";
import { keepAsking } from "../src/robot/asking";
import { BlockedError } from "../src/robot/commands";
import { Drive } from "../src/robot/drive";
import { type Holder, personText } from "../src/robot/gate";
import { HOLD, Jog } from "../src/robot/jog";
import { Permissions } from "../src/robot/permissions";
import { RobotSession } from "../src/robot/session";
import { Stop } from "../src/robot/stop";
import type { WorkerPort } from "../src/robot/transport";

type Op = { op: string; id?: string; topic?: string; msg?: unknown; service?: string; type?: string };

/** A robot in the place of the worker. */
class FakeRobot implements WorkerPort {
  onmessage: WorkerPort["onmessage"] = null;
  onerror: WorkerPort["onerror"] = null;
  ended = 0;
  decodings: ToWorker[] = [];
  bounds: ToWorker[] = [];
  sent: Op[] = [];
  sends: Extract<ToWorker, { kind: "send" }>[] = [];
  socket = 0;
  opens: ToWorker[] = [];
  topics: [string, string][] = [["/cmd_vel", "geometry_msgs/msg/Twist"]];
  services: string[] = [];
  answers: Record<string, unknown> = {};

  postMessage(message: ToWorker): void {
    if (message.kind === "open") {
      this.socket = message.socket;
      this.opens.push(message);
    } else if (message.kind === "close") {
      queueMicrotask(() => this.lose());
    } else if (message.kind === "decodings") {
      this.decodings.push(message);
    } else if (message.kind === "bound") {
      this.bounds.push({ ...message, unbounded: new Set(message.unbounded) });
    } else if (message.kind === "send") {
      this.sends.push(message);
      const op = JSON.parse(message.text) as Op;
      this.sent.push(op);
      if (op.op === "call_service") this.answer(op);
    }
  }

  terminate(): void {
    this.ended++;
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

  answering(silence: number, clockOffset = 0): void {
    this.say({ kind: "answering", socket: this.socket, silence, clockOffset, trip: 0 });
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
    session = new RobotSession({ url: "ws://robot:9090", token: "secret", worker: () => robot });
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

  test("gives a listener of static frames that comes later the last message of each publisher", async () => {
    const tell = (...frames: string[]) =>
      robot.hear({
        op: "publish",
        topic: "/tf_static",
        msg: { transforms: frames.map((name) => ({ child_frame_id: name, at: frames.length })) },
      });
    session.subscribe("/tf_static", "tf2_msgs/msg/TFMessage", () => {}, { throttle: 200 });
    expect(robot.ops("subscribe").at(-1)).toMatchObject({ topic: "/tf_static", throttle_rate: 0 });
    tell("camera", "lens");
    tell("laser");
    tell("lens", "camera");
    const heard: string[][] = [];
    session.subscribe("/tf_static", "tf2_msgs/msg/TFMessage", (message) =>
      heard.push((message.transforms as { child_frame_id: string }[]).map((each) => each.child_frame_id)),
    );
    await vi.advanceTimersByTimeAsync(0);
    expect(heard).toEqual([["laser"], ["lens", "camera"]]);
  });

  test("connects again by itself and subscribes and advertises as before", async () => {
    session.subscribe("/odom", "nav_msgs/msg/Odometry", () => {});
    session.commands.publisher("/cmd_vel", "geometry_msgs/msg/Twist");
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

  describe("whose attempt to connect", () => {
    beforeEach(() => {
      session.subscribe("/camera", "sensor_msgs/msg/Image", () => {}, { decoding: "image" });
      robot.lose();
    });

    test("is not answered gives it up, with its worker, and tries again for longer", async () => {
      await vi.advanceTimersByTimeAsync(250); // attempt 2, which has 20 s
      expect(robot.opens).toHaveLength(2);
      await vi.advanceTimersByTimeAsync(19_900);
      expect(session.state.value).toBe("lost");
      expect(robot.ended).toBe(0);
      const { socket } = robot;
      await vi.advanceTimersByTimeAsync(700);
      expect(robot.ended).toBe(1);
      expect(session.reason.value).toBe("no answer for 20 s");
      expect(robot.opens).toHaveLength(3);
      expect(robot.decodings.at(-1)).toEqual({
        kind: "decodings",
        decodings: new Map([["/camera", "image"]]),
      });
      // What the old one still says is about another connection.
      robot.say({ kind: "open", socket });
      expect(session.state.value).toBe("lost");
      robot.open();
      expect(session.state.value).toBe("open");
      await vi.advanceTimersByTimeAsync(60_000);
      expect(session.state.value).toBe("open");
    });

    test("has a worker whose script does not load says so and tries again", async () => {
      await vi.advanceTimersByTimeAsync(250);
      robot.onerror?.({});
      await vi.advanceTimersByTimeAsync(0);
      expect(session.reason.value).toBe("its worker does not load");
      expect(robot.ended).toBe(1);
      await vi.advanceTimersByTimeAsync(500);
      robot.open();
      expect(session.state.value).toBe("open");
    });

    test("is refused is told why by HTTP, however late, and waits for a token", async () => {
      let answer: (response: Response) => void = () => {};
      vi.stubGlobal("fetch", () => new Promise<Response>((tell) => (answer = tell)));
      await vi.advanceTimersByTimeAsync(250);
      robot.lose();
      await vi.advanceTimersByTimeAsync(4000);
      expect(robot.opens).toHaveLength(2);
      answer(new Response("a token is needed\n", { status: 401 }));
      await vi.advanceTimersByTimeAsync(60_000);
      expect(session.state.value).toBe("refused");
      expect(session.reason.value).toBe("a token is needed");
      expect(robot.opens).toHaveLength(2);
      session.authenticate("better");
      expect(robot.opens.at(-1)).toMatchObject({ protocols: ["rwt", "bearer.better"] });
    });
  });

  test("another token is shown at once, whatever connection or attempt there is", async () => {
    session.authenticate("other");
    await vi.advanceTimersByTimeAsync(0);
    expect(robot.opens.at(-1)).toMatchObject({ socket: 2, protocols: ["rwt", "bearer.other"] });
    session.authenticate("third");
    await vi.advanceTimersByTimeAsync(0);
    expect(robot.opens.at(-1)).toMatchObject({ socket: 3, protocols: ["rwt", "bearer.third"] });
    robot.open();
    expect(session.state.value).toBe("open");
  });

  test("ends its worker with its connection", async () => {
    session.close();
    await vi.advanceTimersByTimeAsync(0);
    expect(robot.ended).toBe(1);
  });

  test("asks what there is though nothing says what may be done, and takes that when it comes", async () => {
    let answer: (response: Response) => void = () => {};
    vi.stubGlobal("fetch", () => new Promise<Response>((tell) => (answer = tell)));
    robot.topics = [["/other", "std_msgs/msg/String"]];
    robot.lose();
    await vi.advanceTimersByTimeAsync(250);
    robot.open();
    await vi.advanceTimersByTimeAsync(4000);
    expect(session.graph.value.topics.has("/other")).toBe(false);
    await vi.advanceTimersByTimeAsync(1100);
    expect(session.graph.value.topics.has("/other")).toBe(true);
    expect(session.may("publish", "/cmd_vel")).toBe(true);
    answer(new Response(JSON.stringify({ role: "viewer", unrestricted: false, allows: {} })));
    await vi.advanceTimersByTimeAsync(0);
    expect(session.may("publish", "/cmd_vel")).toBe(false);
  });

  describe("that keeps asking", () => {
    let told: string[];
    let taken: unknown[];
    let end: () => void;

    beforeEach(() => {
      told = [];
      taken = [];
      robot.answers["/slow"] = undefined;
      end = keepAsking(
        session,
        () => session.call("/slow", {}, "", 1000),
        (answer) => taken.push(answer),
        (problem) => told.push(problem),
      );
    });

    test("asks again after a failure, and no more once there is an answer", async () => {
      await vi.advanceTimersByTimeAsync(1000);
      expect(told).toEqual(["/slow does not answer for 1 s"]);
      robot.answers["/slow"] = { fast: true };
      await vi.advanceTimersByTimeAsync(3000);
      expect(told.at(-1)).toBe("");
      expect(taken).toEqual([{ fast: true }]);
      robot.sent = [];
      await vi.advanceTimersByTimeAsync(2000);
      expect(robot.ops("call_service").filter(({ service }) => service === "/slow")).toEqual([]);
    });

    test("asks anew with each connection, and tells nothing of the one before", async () => {
      robot.lose();
      await vi.advanceTimersByTimeAsync(250);
      robot.answers["/slow"] = { fast: true };
      robot.open();
      await vi.advanceTimersByTimeAsync(0);
      expect(taken).toEqual([{ fast: true }]);
      expect(told).toEqual([""]);
    });

    test("ends", async () => {
      end();
      await vi.advanceTimersByTimeAsync(60_000);
      expect([told, taken]).toEqual([[], []]);
    });
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
    const goal = session.commands.sendGoal(
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
    const aborted = session.commands.sendGoal("/go", "demo/action/Go", { to: 2 }, {});
    const last = { action: "/go", values: { at: 0 }, status: 6, result: true, reason: "the way is blocked" };
    robot.hear({ op: "action_result", id: robot.ops("send_action_goal")[1]?.id, ...last });
    expect(await aborted.outcome).toEqual({
      outcome: "aborted",
      result: { at: 0 },
      text: "the way is blocked",
    });
    expect(feedback).toEqual([{ left: 3 }]);
  });

  test("what the server says of an op is a notice about its topic", () => {
    robot.hear({ op: "status", level: "error", msg: "role 'viewer' may not", id: "publish:/cmd_vel:1" });
    expect(session.notices.value).toEqual([
      {
        number: 1,
        level: "error",
        text: "role 'viewer' may not",
        about: "/cmd_vel",
        count: 1,
        at: expect.any(Number),
      },
    ]);
  });

  test("notices that differ in their numbers are one, with a count", () => {
    for (const lost of [1, 20, 412]) {
      robot.hear({ op: "status", level: "warning", msg: `/cloud: ${lost} messages dropped` });
    }
    robot.hear({ op: "status", level: "warning", msg: "/scan: 1 messages dropped" });
    expect(session.notices.value.map(({ text, count }) => [text, count])).toEqual([
      ["/cloud: 412 messages dropped", 3],
      ["/scan: 1 messages dropped", 1],
    ]);
  });

  describe("commands", () => {
    const acts = () =>
      robot.sent.filter(({ op, service }) => {
        const isRead = String(service ?? "").startsWith("/rosapi/");
        return op === "publish" || op === "send_action_goal" || (op === "call_service" && !isRead);
      });

    test("pass unless the stop is on, the robot is silent, or there is no connection", async () => {
      const { commands } = session;
      const publisher = commands.publisher("/light", "std_msgs/msg/Bool");
      const tryAll = async () => {
        const published = [publisher.publish({ data: true }), publisher.publishFresh({ data: true })];
        await commands.call("/go", {}).catch((error: Error) => {
          if (!(error instanceof BlockedError)) throw error;
        });
        try {
          commands.sendGoal("/dock", "demo/action/Dock", {});
        } catch (error) {
          if (!(error instanceof BlockedError)) throw error;
        }
        return published;
      };
      const stop = new Stop(session);
      stop.stop();
      robot.sent = [];
      expect(await tryAll()).toEqual([false, false]);
      expect(acts()).toEqual([]);
      expect(commands.lastBlocked.value).toMatchObject({ why: "stopped", name: "/dock" });
      publisher.publishZero({ data: false });
      expect(robot.published("/light")).toEqual([{ data: false }]);
      stop.release();
      robot.answering(600);
      robot.sent = [];
      expect(await tryAll()).toEqual([false, false]);
      expect(acts()).toEqual([]);
      robot.answering(0);
      expect(commands.block.value).toBe(null);
      expect(commands.lastBlocked.value).toBe(null);
      robot.lose();
      expect(await tryAll()).toEqual([false, false]);
      expect(commands.block.value).toBe("lost");
    });

    test("that the role does not allow are not sent; what stops the robot always is", () => {
      const allows = { publish: ["/light"], call: ["/go"], set_param: ["/node:speed"] };
      session.permissions.value = new Permissions({ role: "viewer", unrestricted: false, allows });
      const { commands } = session;
      const tryOn = (topic: string, service: string, parameter: string) => {
        const publisher = commands.publisher(topic, "std_msgs/msg/Bool");
        publisher.publishFresh({ data: true });
        for (const [name, request] of [
          [service, {}],
          ["/rosapi/set_param", { name: parameter, value: "1" }],
        ] as const) {
          commands.call(name, request).catch(() => undefined); // What is sent is seen below.
        }
        return publisher.publish({ data: true });
      };
      robot.sent = [];
      expect(tryOn("/cmd_vel", "/stop_motors", "/node:other")).toBe(false);
      expect(() => commands.sendGoal("/dock", "demo/action/Dock", {})).toThrow("the role does not allow it");
      expect(robot.sent.filter(({ op }) => op !== "advertise")).toEqual([]);
      expect(commands.lastBlocked.value).toMatchObject({ why: "role", name: "/dock" });
      expect(tryOn("/light", "/go", "/node:speed")).toBe(true);
      expect(
        robot.sent.map(({ op, service }) => service ?? op).filter((each) => each !== "advertise"),
      ).toEqual(["publish", "/go", "/rosapi/set_param", "publish"]);
      commands.publisher("/cmd_vel", "geometry_msgs/msg/Twist").publishZero({});
      expect(robot.published("/cmd_vel")).toEqual([{}]);
      session.permissions.value = new Permissions(null);
      expect(tryOn("/cmd_vel", "/stop_motors", "/node:other")).toBe(true);
    });

    test("a stop without a connection is sent once there is one", async () => {
      const stop = new Stop(session);
      session.graph.value = {
        ...session.graph.value,
        topics: new Map([["/cmd_vel", "geometry_msgs/msg/Twist"]]),
      };
      robot.lose();
      stop.stop();
      robot.sent = [];
      await vi.advanceTimersByTimeAsync(300);
      robot.open();
      expect(robot.published("/cmd_vel")).toEqual([twist(0, 0)]);
      expect(session.commands.block.value).toBe("stopped");
    });
  });

  test("a topic whose messages are too large ends, and comes back on request", () => {
    const opsOf = (topic: string) => robot.sent.filter((each) => each.topic === topic).map(({ op }) => op);
    session.subscribe("/cloud", "sensor_msgs/msg/PointCloud2", () => undefined);
    robot.say({ kind: "refused", topic: "/cloud", bytes: 64_000_000 });
    expect([...session.refused.value]).toEqual([["/cloud", 64_000_000]]);
    expect(opsOf("/cloud")).toEqual(["subscribe", "unsubscribe"]);
    session.accept("/cloud");
    expect(session.refused.value.size).toBe(0);
    expect(opsOf("/cloud")).toEqual(["subscribe", "unsubscribe", "subscribe"]);
    expect(robot.bounds.at(-1)).toMatchObject({ unbounded: new Set(["/cloud"]) });
  });

  describe("driving", () => {
    let stop: Stop;
    let drive: Drive;

    beforeEach(() => {
      stop = new Stop(session);
      drive = new Drive(session, "/cmd_vel", "geometry_msgs/msg/Twist");
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

    test("a robot that does not answer is told to stand still, and then nothing", async () => {
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      await vi.advanceTimersByTimeAsync(100);
      robot.sent = [];
      robot.answering(600);
      expect(drive.holds("stick")).toBe(false);
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      await vi.advanceTimersByTimeAsync(5000);
      expect(robot.published("/cmd_vel")).toEqual([twist(0, 0), twist(0, 0), twist(0, 0)]);
      robot.answering(0);
      robot.sent = [];
      await vi.advanceTimersByTimeAsync(1000);
      expect(robot.published("/cmd_vel")).toEqual([]);
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      expect(robot.published("/cmd_vel")).toEqual([twist(0.5, 0)]);
    });

    test("a page that stalls says so until a control is taken anew, and only while one was held", async () => {
      drive.hold("keys", { forward: 1, left: 0, turn: 0 });
      vi.setSystemTime(Date.now() + 600);
      await vi.advanceTimersByTimeAsync(100);
      expect([drive.stalled.value, drive.holds("keys")]).toEqual([true, false]);
      await vi.advanceTimersByTimeAsync(5000);
      expect(drive.stalled.value).toBe(true);
      drive.hold("keys", { forward: 1, left: 0, turn: 0 });
      expect(drive.stalled.value).toBe(false);
      drive.release("keys");
      vi.setSystemTime(Date.now() + 600);
      await vi.advanceTimersByTimeAsync(100);
      expect(drive.stalled.value).toBe(false);
    });

    test("a page that was suspended lets all go", async () => {
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      await vi.advanceTimersByTimeAsync(100);
      robot.sent = [];
      vi.setSystemTime(Date.now() + 3000);
      await vi.advanceTimersByTimeAsync(1000);
      expect(robot.published("/cmd_vel")).toEqual([twist(0, 0), twist(0, 0), twist(0, 0)]);
    });

    test("commands may be dropped on their way, standing still may not", () => {
      drive.hold("stick", { forward: 1, left: 0, turn: 0 });
      drive.releaseAll();
      const isCommand = robot.sends.filter(({ text }) => text.includes('"publish"'));
      expect(isCommand.map(({ command }) => typeof command)).toEqual(["number", "undefined"]);
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
        const anna = { role: "operator", user: "anna", device: "Firefox, Android" };
        const ben = { role: "operator", user: "", device: "" };
        const lease = { topic: "/cmd_vel", holder: "rosbridge:1", ...anna };
        gate("/gate/leases", { leases: [{ ...lease, requests: [{ client: "rosbridge:2", ...ben }] }] });
        const holder = stop.gate.holders.value.get("/cmd_vel") as Holder;
        expect(holder).toMatchObject({ name: "rosbridge:1", ...anna });
        expect([holder, ...holder.requests].map(personText)).toEqual(["anna (Firefox, Android)", "operator"]);
        // Once for the name of this page's client, which no lease is given back by.
        expect(called().filter((name) => name === "/gate/release_lease")).toHaveLength(1);
        stop.gate.giveBack("/cmd_vel");
        expect(called().filter((name) => name === "/gate/release_lease")).toHaveLength(2);
      });
    });
  });

  describe("moving joints", () => {
    const ARM = "/arm_controller/joint_trajectory";
    const limits = { upper: 1.5, lower: -1.5, speed: 1, isLinear: false };
    let stop: Stop;
    let jog: Jog;
    type Trajectory = { joint_names: string[]; points: { positions: number[]; time_from_start: object }[] };
    const sent = () => robot.published(ARM) as Trajectory[];
    const positions = () => sent().map(({ points }) => points[0]?.positions);
    const last = () => positions().findLast(Boolean);

    beforeEach(async () => {
      robot.topics = [[ARM, "trajectory_msgs/msg/JointTrajectory"]];
      await vi.advanceTimersByTimeAsync(4000);
      stop = new Stop(session);
      jog = new Jog(session, ARM, [
        { name: "pan", ...limits },
        { name: "lift", ...limits },
      ]);
      jog.share = 0.5;
    });

    const measure = (pan: number, lift: number) =>
      jog.measure(
        new Map([
          ["pan", pan],
          ["lift", lift],
        ]),
      );

    test("nothing is sent before all positions are known, or without a change", async () => {
      jog.measure(new Map([["pan", 0]]));
      jog.move("pan", 0.1);
      await vi.advanceTimersByTimeAsync(1000);
      expect(sent()).toEqual([]);
    });

    test("steps at the speed that is set, with all joints, then holds them", async () => {
      measure(0, 0.4);
      jog.move("pan", 0.1);
      await vi.advanceTimersByTimeAsync(3000);
      const [first] = sent();
      expect(first?.joint_names).toEqual(["pan", "lift"]);
      expect(first?.points[0]?.time_from_start).toEqual({ sec: 0, nanosec: 200_000_000 });
      const found = positions();
      expect(found).toHaveLength(8);
      expect(sent().at(-1)).toEqual(HOLD);
      for (const [at, pan] of [0.025, 0.05, 0.075, 0.1, 0.1, 0.1, 0.1].entries()) {
        expect(found[at]?.[0]).toBeCloseTo(pan);
        expect(found[at]?.[1]).toBe(0.4);
      }
      expect(jog.wanted.value.size).toBe(0);
    });

    test("a push moves joints until it is released, at its share of the speed, to the limits", async () => {
      measure(1.4, 0);
      const push = () =>
        jog.push(
          new Map([
            ["pan", 1],
            ["lift", -0.5],
          ]),
        );
      push();
      expect(jog.isPushed).toBe(true);
      await vi.advanceTimersByTimeAsync(1000);
      expect(last()?.[0]).toBe(1.5);
      expect(last()?.[1]).toBeCloseTo(-0.25);
      jog.release();
      expect(sent().at(-1)).toEqual(HOLD);
      expect(jog.isPushed).toBe(false);
      const count = sent().length;
      jog.release();
      await vi.advanceTimersByTimeAsync(1000);
      expect(sent()).toHaveLength(count);
      push();
      jog.hold();
      expect(jog.isPushed).toBe(false);
    });

    test("a position beyond the limits is the limit", async () => {
      measure(1.45, 0);
      jog.move("pan", 99);
      await vi.advanceTimersByTimeAsync(2000);
      expect(last()?.[0]).toBe(1.5);
    });

    test("a sagging arm is not lowered; one that was moved otherwise is left there", async () => {
      measure(0, 0.4);
      jog.move("pan", 0.02);
      await vi.advanceTimersByTimeAsync(1000);
      measure(0.02, 0.38);
      jog.move("pan", 0);
      await vi.advanceTimersByTimeAsync(1000);
      expect(last()?.[1]).toBe(0.4);
      measure(0, -0.5);
      jog.move("pan", 0.02);
      await vi.advanceTimersByTimeAsync(1000);
      expect(last()?.[1]).toBe(-0.5);
    });

    test("a stop holds the joints, is latched, and nothing moves by its release", async () => {
      measure(0, 0);
      jog.move("pan", 1);
      await vi.advanceTimersByTimeAsync(200);
      robot.sent = [];
      stop.stop();
      jog.move("pan", 1);
      await vi.advanceTimersByTimeAsync(1500);
      expect(sent().length).toBeGreaterThan(9);
      for (const message of sent()) expect(message).toEqual(HOLD);
      robot.sent = [];
      stop.release();
      await vi.advanceTimersByTimeAsync(1000);
      expect(sent()).toEqual([]);
    });

    test("a busy page goes on with a new grip", async () => {
      measure(0, 0);
      jog.move("pan", 1);
      await vi.advanceTimersByTimeAsync(200);
      robot.sent = [];
      vi.setSystemTime(Date.now() + 1000);
      await vi.advanceTimersByTimeAsync(100);
      const [first, second, third] = positions();
      expect(sent()[0]).toEqual(HOLD);
      expect(first).toBeUndefined();
      expect(second?.[0]).toBeCloseTo(0.15);
      expect(third?.[0]).toBeCloseTo(0.175);
    });

    test("holding, leaving the panel, a silent robot and a suspended page end it", async () => {
      const begin = async () => {
        measure(0, 0);
        jog.move("pan", 1);
        await vi.advanceTimersByTimeAsync(200);
        expect(jog.wanted.value.get("pan")).toBe(1);
        robot.sent = [];
      };
      await begin();
      jog.hold();
      await vi.advanceTimersByTimeAsync(1000);
      expect(sent()).toEqual([HOLD]);
      await begin();
      robot.answering(600);
      await vi.advanceTimersByTimeAsync(1000);
      expect(sent()).toEqual([HOLD]);
      robot.answering(0);
      await begin();
      vi.setSystemTime(Date.now() + 3000);
      await vi.advanceTimersByTimeAsync(1000);
      expect(sent()).toEqual([HOLD]);
      await begin();
      jog.dispose();
      await vi.advanceTimersByTimeAsync(1000);
      expect(sent()).toEqual([HOLD]);
    });
  });
});
