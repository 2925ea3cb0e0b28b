// @vitest-environment happy-dom

import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import type { Ros } from "../../src/dropin/globals";
import { COMMAND_PERIOD, Teleop, type Twist } from "../../src/dropin/keyboardteleop";
import { FakeRos, installRoslib, published } from "./fakes";

let ros: FakeRos;

function make(options: object = {}): Teleop {
  return new Teleop({ ros: ros as unknown as Ros, ...options });
}

function key(kind: "keydown" | "keyup", keyCode: number, more: object = {}, target: Element = document.body) {
  target.dispatchEvent(new KeyboardEvent(kind, { keyCode, bubbles: true, ...more } as KeyboardEventInit));
}

const speeds = () =>
  published.map(({ message }) => {
    const { linear, angular } = message as Twist;
    return [linear.x, linear.y, angular.z];
  });

beforeEach(() => {
  vi.useFakeTimers();
  installRoslib(1);
  ros = new FakeRos();
  document.body.replaceWith(document.createElement("body"));
});

afterEach(() => {
  ros.lose();
  vi.useRealTimers();
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
});

describe("keys", () => {
  test.each([
    [87, [0.5, 0, 0]],
    [38, [0.5, 0, 0]],
    [83, [-0.5, 0, 0]],
    [40, [-0.5, 0, 0]],
    [65, [0, 0, 1]],
    [37, [0, 0, 1]],
    [68, [0, 0, -1]],
    [39, [0, 0, -1]],
    [81, [0, 0.5, 0]],
    [69, [0, -0.5, 0]],
  ])("%i moves by %j and stands still when it is let go", (code, speed) => {
    make();
    key("keydown", code);
    key("keyup", code);
    expect(speeds()).toEqual([speed, [0, 0, 0]]);
    expect(published[0]).toMatchObject({ topic: "/cmd_vel", type: "geometry_msgs/Twist" });
  });

  test("two keys add up, and each ends alone", () => {
    make();
    key("keydown", 38);
    key("keydown", 37);
    key("keyup", 38);
    key("keyup", 37);
    expect(speeds()).toEqual([
      [0.5, 0, 0],
      [0.5, 0, 1],
      [0, 0, 1],
      [0, 0, 0],
    ]);
  });

  test("other keys, and keys with a modifier, send nothing", () => {
    make();
    key("keydown", 66);
    key("keydown", 87, { ctrlKey: true });
    expect(published).toEqual([]);
  });

  test("text fields keep their keys, and a slider the arrows", () => {
    make();
    const text = document.createElement("input");
    const slider = document.createElement("input");
    slider.type = "range";
    document.body.append(text, slider);
    key("keydown", 87, {}, text);
    key("keydown", 38, {}, slider);
    expect(published).toEqual([]);
    key("keydown", 87, {}, slider);
    expect(speeds()).toEqual([[0.5, 0, 0]]);
  });
});

describe("speed", () => {
  test("is scaled by throttle and scale, which holds at once", () => {
    const teleop = make({ topic: "/base_controller/command", throttle: 0.5 });
    teleop.scale = 0.5;
    teleop.handleKey(38, true);
    teleop.scale = 1;
    vi.advanceTimersByTime(COMMAND_PERIOD);
    expect(speeds()).toEqual([
      [0.125, 0, 0],
      [0.25, 0, 0],
    ]);
    expect(published[0]?.topic).toBe("/base_controller/command");
  });

  test("is told when it changes, and only then", () => {
    const told: Twist[] = [];
    const teleop = make();
    teleop.on("change", (twist: Twist) => told.push(twist));
    teleop.handleKey(38, true);
    vi.advanceTimersByTime(COMMAND_PERIOD * 3);
    teleop.handleKey(38, false);
    expect(told.map(({ linear }) => linear.x)).toEqual([0.5, 0]);
  });
});

describe("hold to run", () => {
  test("commands are repeated while a key is held, and not after", () => {
    make();
    key("keydown", 38);
    vi.advanceTimersByTime(COMMAND_PERIOD * 4);
    expect(published).toHaveLength(5);
    key("keyup", 38);
    vi.advanceTimersByTime(COMMAND_PERIOD * 10);
    expect(published).toHaveLength(6);
  });

  test.each([
    ["blur", () => window.dispatchEvent(new Event("blur"))],
    ["pagehide", () => window.dispatchEvent(new Event("pagehide"))],
    [
      "hidden",
      () => {
        vi.spyOn(document, "hidden", "get").mockReturnValue(true);
        document.dispatchEvent(new Event("visibilitychange"));
      },
    ],
  ])("%s stands still, and a key that repeats begins nothing", (_, happen) => {
    make();
    key("keydown", 38);
    happen();
    key("keydown", 38, { repeat: true });
    vi.advanceTimersByTime(COMMAND_PERIOD * 5);
    expect(speeds()).toEqual([
      [0.5, 0, 0],
      [0, 0, 0],
    ]);
  });

  test("nothing is left for the next connection when one is lost", () => {
    make();
    key("keydown", 38);
    ros.lose();
    key("keydown", 37);
    vi.advanceTimersByTime(COMMAND_PERIOD * 5);
    ros.isConnected = true;
    vi.advanceTimersByTime(COMMAND_PERIOD * 5);
    expect(speeds()).toEqual([[0.5, 0, 0]]);
  });
});

test("a page without roslib is told so", () => {
  vi.unstubAllGlobals();
  expect(() => make()).toThrow("ROSLIB is not there: the page has to load roslib.min.js before this script");
});
