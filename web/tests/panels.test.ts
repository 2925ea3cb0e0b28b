// @vitest-environment happy-dom
import { describe, expect, test, vi } from "vitest";
import { pacer, quaternionOf } from "../src/device/sensors";
import { wishOfKeys } from "../src/elements/teleop/controls";
import { followGamepad, pushOfGamepad, wishOfGamepad } from "../src/elements/teleop/gamepad";
import { parts } from "../src/forms/message_tree";
import { fitting } from "../src/forms/suggest";
import { talks } from "../src/panels/graph/nodes_panel";
import { nodeOf } from "../src/panels/graph/parameters_panel";
import { logLevel } from "../src/panels/health/log";
import { pausableNodes } from "../src/panels/health/player";
import { readMetrics } from "../src/panels/health/server";
import { partOf, plotSettings } from "../src/panels/view/plot_panel";
import { roundedStep } from "../src/panels/view/position_panel";
import { Series } from "../src/panels/view/series";
import { numberAt, numericPaths, selectedFields } from "../src/robot/fields";
import { fixOf, Track } from "../src/robot/fixes";
import { Formula, formulaProblem } from "../src/robot/formula";
import { jointsOf } from "../src/robot/jog";
import { PartReader } from "../src/robot/mjpeg";
import { placeOf } from "../src/scene/tools";

test.each([
  ["fields", Object.fromEntries(Array.from({ length: 3000 }, (_, at) => [`f${at}`, at])), 500],
  ["items", Array.from({ length: 3000 }, (_, at) => at), 50],
  ["numbers", new Float32Array(3000), 50],
])("of very many %s the first are drawn, and the others are counted", (_, value, count) => {
  const { shown, hidden } = parts(value);
  expect([shown.length, hidden]).toEqual([count, 3000 - count]);
});

describe("driving", () => {
  test("keys that are held together add up", () => {
    expect(wishOfKeys(["ArrowUp", "a"])).toEqual({ forward: 1, left: 0, turn: 1 });
    expect(wishOfKeys(["w", "s", "x"])).toEqual({ forward: 0, left: 0, turn: 0 });
  });

  const pad = (held: number, axes: number[]) => ({
    axes,
    buttons: Array.from({ length: 8 }, (_, at) => ({ pressed: at === held }) as GamepadButton),
  });

  test("a gamepad drives only while a shoulder button is held", () => {
    expect(wishOfGamepad(pad(6, [0, -1, 1, 0]))).toBeNull();
    expect(wishOfGamepad(pad(5, [0.05, -1, 0.5, 0]))).toEqual({ forward: 1, left: 0, turn: -0.5 });
  });

  test("a gamepad moves the first four joints while the left trigger is held, else the next ones", () => {
    const names = ["a", "b", "c", "d", "e", "f"];
    expect(pushOfGamepad(pad(5, [1, 0, 0, 0]), names)).toBeNull();
    expect([...(pushOfGamepad(pad(6, [-1, 0.05, 0.5, 0]), names) ?? [])]).toEqual([
      ["a", 1],
      ["b", 0],
      ["c", -0.5],
      ["d", 0],
    ]);
    expect([...(pushOfGamepad(pad(7, [0, 1, 0, 0]), names)?.keys() ?? [])]).toEqual(["e", "f"]);
    expect(pushOfGamepad(pad(7, [0, 1, 0, 0]), ["a"])).toBeNull();
  });

  test("a gamepad that was held before, or lost its grip, drives after it was released", () => {
    vi.useFakeTimers();
    let held = pad(4, [0, -1, 0, 0]);
    let isHeld = false;
    vi.stubGlobal("navigator", { getGamepads: () => [held] });
    vi.stubGlobal("document", { hasFocus: () => true });
    const end = followGamepad(wishOfGamepad, {
      isHeld: () => isHeld,
      hold: () => {
        isHeld = true;
      },
      release: () => {
        isHeld = false;
      },
    });
    const grip = (button: number) => {
      held = pad(button, [0, -1, 0, 0]);
      vi.advanceTimersByTime(200);
      return isHeld;
    };
    expect([grip(4), grip(-1), grip(4)]).toEqual([false, false, true]);
    isHeld = false; // A stop, or a lost connection.
    expect([grip(4), grip(-1), grip(4)]).toEqual([false, false, true]);
    end();
    vi.unstubAllGlobals();
    vi.useRealTimers();
  });
});

describe("positions by satellite", () => {
  const message = { status: { status: 0 }, latitude: 52.5, longitude: 179.9999, altitude: null };

  test("what is no position is none", () => {
    expect(fixOf({ ...message, status: { status: -1 } })).toBeNull();
    expect(fixOf({ ...message, latitude: null })).toBeNull();
    expect(fixOf({ ...message, latitude: 91 })).toBeNull();
    expect(fixOf(message)).toEqual({ latitude: 52.5, longitude: 179.9999, altitude: null, radius: null });
  });

  test("a track crosses the line of date, and stays bounded", () => {
    const track = new Track();
    track.add({ latitude: 0, longitude: 179.9999, altitude: null, radius: null });
    const [east, north] = track.add({ latitude: 0.0001, longitude: -179.9999, altitude: null, radius: null });
    expect(east).toBeCloseTo(22.24, 2);
    expect(north).toBeCloseTo(11.12, 2);
    for (let at = 0; at < 20_000; at++) {
      track.add({ latitude: at / 1e5, longitude: 180, altitude: null, radius: null });
    }
    expect(track.points.length).toBeLessThanOrEqual(4000);
    expect(track.length).toBeGreaterThan(20_000);
  });

  test("the grid has round steps", () => {
    expect([0.9, 1, 3, 26, 70, 1000].map(roundedStep)).toEqual([0.5, 1, 2, 20, 50, 1000]);
  });
});

describe("joints of a description", () => {
  const urdf = (inner: string) => `<robot name="r"><link name="a"/>${inner}</robot>`;
  const limit = '<limit lower="-1" upper="2" velocity="3" effort="1"/>';

  test("joints with limits of their own", () => {
    const joints = jointsOf(
      urdf(
        `<joint name="pan" type="revolute">${limit}</joint>
         <joint name="rail" type="prismatic"><limit lower="0" upper="0.5" effort="1"/></joint>
         <joint name="wheel" type="continuous">${limit}</joint>
         <joint name="mount" type="fixed"/>
         <joint name="finger" type="revolute">${limit}<mimic joint="pan"/></joint>
         <joint name="odd" type="revolute"><limit lower="x" upper="1"/></joint>
         <joint name="far" type="revolute"><limit lower="-Infinity" upper="1"/></joint>
         <joint name="away" type="revolute"><limit lower="0" upper="1" velocity="-0.5"/></joint>`,
      ),
    );
    expect(joints).toEqual([
      { name: "pan", lower: -1, upper: 2, speed: 2, isLinear: false },
      { name: "rail", lower: 0, upper: 0.5, speed: 1, isLinear: true },
      { name: "away", lower: 0, upper: 1, speed: 0.5, isLinear: false },
    ]);
  });

  test("only so many are moved", () => {
    expect(jointsOf(urdf(`<joint name="a" type="revolute">${limit}</joint>`.repeat(1000))).length).toBe(100);
  });

  test.each(["", "no XML", "<robot><joint", "<a/>"])("%s has none", (text) => {
    expect(jointsOf(text)).toEqual([]);
  });
});

describe("rates of sensors", () => {
  test.each([16.7, 10, 20, 33.3])("events %d ms apart become 20 messages a second", (interval) => {
    const isDue = pacer(50);
    let count = 0;
    for (let now = 1000; now < 11_000; now += interval) if (isDue(now)) count++;
    expect(count / 10).toBeCloseTo(20, 0);
  });

  test("slower events all pass, and a pause is not made up for", () => {
    const isDue = pacer(50);
    expect([0, 80, 160, 1000, 1001, 1049, 1050].map(isDue)).toEqual([
      true,
      true,
      true,
      true,
      false,
      false,
      true,
    ]);
  });
});

describe("values by their paths", () => {
  const message = { pose: { x: 1.5, ok: true, name: "a" }, ranges: [1, null, 3], $points: { count: 9 } };

  test.each([
    ["pose.x", 1.5],
    ["pose.ok", 1],
    ["ranges.2", 3],
    ["ranges.1", Number.NaN],
    ["pose.name", Number.NaN],
    ["nothing.at.all", Number.NaN],
    ["constructor.length", Number.NaN],
  ])("%s", (path, value) => expect(numberAt(message, path)).toBe(value));

  test("what can be plotted", () => {
    expect(numericPaths(message)).toEqual(["pose.x", "pose.ok", "ranges.0", "ranges.2"]);
    expect(numericPaths({ list: new Float32Array(1000) }).length).toBe(32);
  });

  test("by their names, and those that differ from an earlier message", () => {
    const message = { pose: { x: 1, note: "a", far: null }, ids: [2n] };
    expect(selectedFields(message, "POSE.").map(({ path }) => path)).toEqual([
      "pose.x",
      "pose.note",
      "pose.far",
    ]);
    const earlier = { pose: { x: 1, note: "b", far: 3 }, ids: [2n] };
    expect(selectedFields(message, "", earlier)).toEqual([
      { path: "pose.note", value: "a", earlier: "b" },
      { path: "pose.far", value: null, earlier: 3 },
    ]);
  });
});

describe("series of a plot", () => {
  test("values of different times stand side by side, and those that are no number are gaps", () => {
    const [one, other] = [new Series(), new Series()];
    one.push(1, 10);
    other.push(2, 20);
    one.push(3, Number.NaN);
    other.push(3, 30);
    expect(Series.together([one, other])).toEqual([
      [1, 2, 3],
      [10, null, null],
      [null, 20, 30],
    ]);
  });

  test("keeps a minute, and never more than it has room for", () => {
    const series = new Series();
    for (let at = 0; at < 200_000; at++) series.push(at / 1000, at);
    const [times = [], values = []] = Series.together([series]);
    expect(values.at(-1)).toBe(199_999);
    expect(times[0]).toBe(139.999);
    const endless = new Series(1e9);
    for (let at = 0; at < 3_000_000; at++) endless.push(at, 0);
    expect(endless.length).toBeLessThanOrEqual(1 << 20);
    expect(endless.length).toBeGreaterThanOrEqual(1 << 19);
  });

  test("a time that goes back begins anew", () => {
    const series = new Series();
    series.push(5, 1);
    series.push(3, 2);
    expect([series.span, series.at(4), series.at(2)]).toEqual([[3, 3], 2, Number.NaN]);
  });

  test("a million values are drawn by their extents, with every peak and gap", () => {
    const series = new Series(1e9);
    for (let at = 0; at < 1_000_000; at++) {
      const isGap = at > 300_000 && at < 400_000;
      series.push(at, at === 654_321 ? 99 : isGap ? Number.NaN : Math.sin(at));
    }
    const points: number[] = [];
    series.draw(0, 999_999, 800, (_, value) => points.push(value));
    expect(points.length).toBeLessThanOrEqual(4 * 800);
    expect(Math.max(...points.filter(Number.isFinite))).toBe(99);
    expect(points.some(Number.isNaN)).toBe(true);
    expect(series.extent(700_000, 800_000)[1]).toBeLessThanOrEqual(1);
    const near: [number, number][] = [];
    series.draw(654_320, 654_322, 800, (time, value) => near.push([time, value]));
    expect(near).toContainEqual([654_321, 99]);
    expect(near.length).toBeLessThan(6);
  });

  test("statistics of a part", () => {
    const series = new Series();
    for (const [at, value] of [5, 1, Number.NaN, 3, 100].entries()) series.push(at, value);
    expect(series.statistics(1, 4)).toEqual({ count: 2, least: 1, most: 3, mean: 2, deviation: 1 });
    expect(series.statistics(9, 10).count).toBe(0);
  });

  test("one field against another takes what the other was then", () => {
    const [x, y] = [new Series(), new Series()];
    x.push(0, 10);
    y.push(1, 1);
    x.push(2, 20);
    y.push(2, 2);
    const points: [number, number][] = [];
    y.drawAgainst(x, 0, 9, 100, (across, value) => points.push([across, value]));
    expect(points).toEqual([
      [10, 1],
      [20, 2],
    ]);
  });
});

describe("slices and filters of paths", () => {
  const message = {
    marks: [
      { id: 1, ns: "a@b", on: true, x: 10, parts: [1, 2] },
      { id: 2, ns: "c", on: false, x: 20, parts: [3] },
      { id: 3n, ns: "c", on: true, x: 30, parts: [] },
    ],
    ranges: new Float32Array([4, 5, 6, 7]),
  };

  test.each([
    ["marks[:]{id==2}.x", 20],
    ["marks[:]{id==3}.x", 30],
    ["marks[:].x.@max", 30],
    ["marks[:]{ns=='c'}.x.@mean", 25],
    ['marks[:]{ns=="a@b"}.x', 10],
    ["marks[:]{on==true}{x>10}.x", 30],
    ["marks[:]{x<=20}.@length", 2],
    ["marks[:]{ns!='c'}.parts[1]", 2],
    ["marks[:].parts[:].@length", 3],
    ["marks[:]{parts[0]==3}.id", 2],
    ["marks[:]{id==9}.@length", 0],
    ["marks[0]{id==1}.x", 10],
    ["ranges[1:2].@mean", 5.5],
    ["ranges[-2:].@mean", 6.5],
    ["ranges[:1].@length", 2],
    ["ranges[-1]", 7],
    ["ranges[2:99].@length", 2],
  ])("%s", (text, value) => expect(new Formula(text).numberOf(message, 0)).toBe(value));

  test.each([
    "marks[:].x",
    "marks[:]{id==9}.x",
    "marks[0]{id==2}.x",
    "marks[:]{id=='1'}.x",
    "ranges[-5]",
    "ranges[9]",
  ])("%s is no number", (text) => expect(new Formula(text).numberOf(message, 0)).toBeNaN());

  test.each(["marks[", "marks[a]", "marks{id}", "marks{id=1}", "marks{id==x}", "marks[:]{id==1"])(
    "%s is rejected",
    (text) => expect(formulaProblem(text)).not.toBe(""),
  );

  test("values have a bound, however lists are nested", () => {
    const long = Array.from({ length: 5000 }, () => new Uint8Array(5000));
    expect(new Formula("[:][:].@length").numberOf(long, 0)).toBe(10_000);
  });
});

describe("formulas", () => {
  const message = {
    v: { x: 3, y: 4 },
    ranges: new Float32Array([1, Number.POSITIVE_INFINITY, 2]),
    q: { x: 0, y: 0, z: Math.SQRT1_2, w: Math.SQRT1_2 },
    big: 5n,
    text: "a",
  };

  test.each([
    ["v.x", 3],
    ["v.@norm", 5],
    ["v.@norm.@mul(3.6).@add(-1)", 17],
    ["v.x.@negative.@abs", 3],
    ["q.@yaw.@degrees", 90],
    ["ranges.@min", 1],
    ["ranges.@length", 3],
    ["big", 5],
  ])("%s", (text, value) => expect(new Formula(text).numberOf(message, 0)).toBeCloseTo(value));

  test.each(["text.@abs", "nothing.@norm", "v"])("%s is no number", (text) =>
    expect(new Formula(text).numberOf(message, 0)).toBeNaN(),
  );

  test("changes over time", () => {
    const speed = new Formula("data.@derivative");
    const step = new Formula("data.@delta");
    const values = [1, 2, 6].map((data, at) => [
      speed.numberOf({ data }, at * 2),
      step.numberOf({ data }, at * 2),
    ]);
    expect(values).toEqual([
      [Number.NaN, Number.NaN],
      [0.5, 1],
      [2, 4],
    ]);
    expect(speed.numberOf({ data: 7 }, 4)).toBe(Number.NaN);
  });

  test.each(["x.@nonsense", "x.@mul", "x.@mul(a)", "x.@constructor", "x.@norm(2)"])(
    "%s is rejected by its name",
    (text) => {
      expect(formulaProblem(text)).toContain("@");
      expect(new Formula("x").path).toBe("x");
    },
  );

  test("settings of a plot from a strange layout", () => {
    const line = { topic: "/a", path: "b.@norm" };
    const strange = { lines: [line, null, { topic: 1 }, { topic: "/a", path: "@x" }], marks: [1, "2", null] };
    expect(plotSettings({ ...strange, x: "time", seconds: 1e9, linked: false }, [])).toEqual({
      lines: [line],
      marks: [1],
      x: null,
      seconds: 60,
      statistics: false,
      linked: false,
    });
    expect(plotSettings({ lines: "all" }, [line]).lines).toEqual([line]);
  });

  test("zoom stays within what there is", () => {
    expect(partOf([0, 10], [0, 10], 0.5, 0)).toEqual([2.5, 7.5]);
    expect(partOf([2, 4], [0, 10], 1, -5)).toEqual([0, 2]);
    expect(partOf([2, 4], [0, 10], 9, 0)).toBeNull();
  });

  test("names that fit, those that begin with the text first", () => {
    const names = ["/arm/odom", "/odom", "/odom/filtered", "/scan"];
    expect(fitting(names, "/odom")).toEqual(["/odom", "/odom/filtered", "/arm/odom"]);
    expect(fitting(names, "odom arm")).toEqual(["/arm/odom"]);
    expect(fitting(names, "")).toEqual(names);
  });
});

describe("a stream of pictures", () => {
  const encode = (text: string) => new TextEncoder().encode(text);
  const part = (body: string) =>
    encode(
      `--edge\r\nContent-Type: image/jpeg\r\nContent-Length: ${body.length}\r\nX-Timestamp: 1.5\r\n\r\n${body}\r\n`,
    );

  test.each([1, 7, 1000])("in pieces of %i octets", (size) => {
    const all = Uint8Array.from([...part("first"), ...part("\r\n\r\n"), ...part("")]);
    const reader = new PartReader();
    const bodies: string[] = [];
    for (let at = 0; at < all.length; at += size) {
      for (const { body, type, stamp } of reader.push(all.subarray(at, at + size))) {
        expect([type, stamp]).toEqual(["image/jpeg", 1.5]);
        bodies.push(new TextDecoder().decode(body));
      }
    }
    expect(bodies).toEqual(["first", "\r\n\r\n", ""]);
  });

  test("a part without a length, or without an end, is refused", () => {
    expect(() => new PartReader().push(encode("--edge\r\nContent-Type: x\r\n\r\n"))).toThrow("no length");
    expect(() => new PartReader().push(encode(`Content-Length: 99999999999\r\n\r\n`))).toThrow("no length");
    expect(() => new PartReader().push(new Uint8Array(10_000))).toThrow("no end");
  });
});

test("metrics in the format of Prometheus", () => {
  const text = '# HELP a b\na_total{topic="/x \\"y\\"",why="queue"} 3\nb 1.5e-3\nnot a metric\n';
  expect(readMetrics(text)).toEqual([
    { name: "a_total", labels: { topic: '/x "y"', why: "queue" }, value: 3 },
    { name: "b", labels: {}, value: 0.0015 },
  ]);
});

test("levels of logs of both generations", () => {
  expect([10, 20, 30, 40, 50].map(logLevel)).toEqual([0, 1, 2, 3, 4]);
  expect([1, 2, 4, 8, 16].map(logLevel)).toEqual([0, 1, 2, 3, 4]);
  expect(logLevel(Number.NaN)).toBe(0);
});

test("nodes of parameters and of players", () => {
  expect(["/robot:speed", "/ns/robot:a", "/robot/speed", "/speed"].map(nodeOf)).toEqual([
    "/robot",
    "/ns/robot",
    "/robot",
    "/",
  ]);
  expect(pausableNodes(["/p/toggle_paused", "/p/is_paused", "/q/pause"])).toEqual(["/p"]);
});

test("who talks to whom, without the topics that everybody has", () => {
  const details = new Map([
    ["/a", { publishing: ["/x", "/rosout"], subscribing: [], services: [] }],
    ["/b", { publishing: ["/y"], subscribing: ["/x"], services: [] }],
  ]);
  expect(talks(details, "")).toEqual([{ topic: "/x", from: ["/a"], to: ["/b"] }]);
  expect(talks(details, "", true).map(({ topic, to }) => [topic, to])).toEqual([
    ["/x", ["/b"]],
    ["/y", []],
  ]);
  expect(talks(details, "/b").map(({ topic }) => topic)).toEqual(["/x", "/y"]);
});

test("a drag gives a direction, and a click gives none", () => {
  expect(placeOf({ x: 1, y: 2 }, { x: 1, y: 3 })).toEqual({ x: 1, y: 2, yaw: Math.PI / 2 });
  expect(placeOf({ x: 1, y: 2 }, { x: 1.05, y: 2 }).yaw).toBe(0);
});

test("the turn of a device: flat it is none, and alpha turns about z", () => {
  expect(quaternionOf(0, 0, 0)).toEqual({ x: 0, y: 0, z: 0, w: 1 });
  const { x, y, z, w } = quaternionOf(90, 0, 0);
  expect([x, y]).toEqual([0, 0]);
  expect([z, w]).toEqual([expect.closeTo(Math.SQRT1_2), expect.closeTo(Math.SQRT1_2)]);
});
