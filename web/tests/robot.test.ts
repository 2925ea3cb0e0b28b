import { describe, expect, test } from "vitest";
import { header, seconds, shortType } from "../src/robot/names";
import { globFits, Permissions } from "../src/robot/permissions";
import { jsonOf } from "../src/robot/transport";
import { Definitions, namedValues, numberOf, valueError } from "../src/robot/typedefs";

describe("roles", () => {
  test.each([
    ["*", "/a/b", true],
    ["/tf*", "/tf_static", true],
    ["/tf", "/tf_static", false],
    ["/robot/*", "/robot/a/b", true],
    ["/c?d", "/cmd", true],
    ["/[ab]", "/b", true],
    ["/[!ab]", "/b", false],
    ["/a.b", "/axb", false],
    ["/(a)", "/(a)", true],
    ["/[a", "/[a", true],
  ])("glob %s and %s", (glob, name, fits) => expect(globFits(glob, name)).toBe(fits));

  test("what a server does not list is not offered; a server that lists nothing is asked by trying", () => {
    const viewer = new Permissions({ role: "viewer", unrestricted: false, allows: { subscribe: ["*"] } });
    expect(viewer.may("subscribe", "/odom")).toBe(true);
    expect(viewer.may("publish", "/cmd_vel")).toBe(false);
    expect(new Permissions(null).may("publish", "/cmd_vel")).toBe(true);
  });
});

describe("names and times of both generations", () => {
  test("types", () => {
    expect(shortType("geometry_msgs/msg/Twist")).toBe("geometry_msgs/Twist");
    expect(shortType("geometry_msgs/Twist")).toBe("geometry_msgs/Twist");
  });

  test("times", () => {
    expect(seconds({ sec: 1, nanosec: 5e8 })).toBe(1.5);
    expect(seconds({ secs: 1, nsecs: 5e8 })).toBe(1.5);
    expect(seconds(null)).toBeNaN();
    expect(header(1, "map", 1500)).toEqual({ stamp: { secs: 1, nsecs: 500000000 }, frame_id: "map" });
  });
});

describe("definitions", () => {
  const definitions = new Definitions([
    {
      type: "demo_msgs/msg/Status",
      fieldnames: ["status", "names", "pose", "pair"],
      fieldtypes: ["uint8", "string", "demo_msgs/Pose", "float64"],
      fieldarraylen: [-1, 0, -1, 2],
      constnames: ["STATUS_IDLE", "STATUS_BUSY", "LABEL"],
      constvalues: ["0", "1", "text"],
    },
    {
      type: "demo_msgs/Pose",
      fieldnames: ["x", "ok"],
      fieldtypes: ["float64", "bool"],
      fieldarraylen: [-1, -1],
    },
  ]);

  test("an empty message", () => {
    const empty = { status: 0, names: [], pose: { x: 0, ok: false }, pair: [0, 0] };
    expect(definitions.empty()).toEqual(empty);
  });

  test("constants name the values of the field that they begin with", () => {
    const [field] = definitions.root.fields;
    const names = field && namedValues(definitions.root, field).map(({ name }) => name);
    expect(names).toEqual(["STATUS_IDLE", "STATUS_BUSY"]);
  });

  test.each([
    ["uint8", "256", "range"],
    ["uint8", "-1", "range"],
    ["int32", "1.5", "integer"],
    ["float64", "x", "number"],
    ["float64", "", "number"],
    ["float64", "1e3", null],
    ["string", "anything", null],
    ["int64", "-9223372036854775808", null],
    ["uint64", "18446744073709551615", null],
    ["uint64", "18446744073709551616", "range"],
  ])("%s %s", (type, text, wrong) => expect(valueError(type, text)).toBe(wrong));

  test("integers of 64 bits keep their digits", () => {
    expect(numberOf("42")).toBe(42);
    const data = numberOf("9007199254740993");
    expect(data).toBe(9007199254740993n);
    expect(jsonOf({ data, text: "x", list: [1.5] })).toBe(
      "rawJSON" in JSON
        ? '{"data":9007199254740993,"text":"x","list":[1.5]}'
        : '{"data":9007199254740992,"text":"x","list":[1.5]}',
    );
  });
});
