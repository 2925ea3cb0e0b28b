import { describe, expect, test, vi } from "vitest";
import vectors from "../../docs/reference/point-clouds.vectors.json";
import { setBound, tooLarge } from "../src/decode/bound";
import { decodeCbor } from "../src/decode/cbor";
import { decodeCloud } from "../src/decode/cloud";
import { type CompressedCloud, decompressCloud } from "../src/decode/cloud_planes";
import { decodeImage } from "../src/decode/image";
import { makeWhole } from "../src/decode/whole_cloud";

const bytes = (hex: string) => Uint8Array.from(hex.match(/../g) ?? [], (pair) => Number.parseInt(pair, 16));

describe("CBOR, by the examples of RFC 8949 appendix A", () => {
  test.each([
    ["00", 0],
    ["1903e8", 1000],
    ["1b000000e8d4a51000", 1000000000000],
    ["3903e7", -1000],
    ["f93c00", 1],
    ["f90001", 2 ** -24],
    ["f97c00", Number.POSITIVE_INFINITY],
    ["fa47c35000", 100000],
    ["fb3ff199999999999a", 1.1],
    ["f5", true],
    ["f6", null],
    ["62c3bc", "ü"],
    ["83010203", [1, 2, 3]],
    ["a26161016162820203", { a: 1, b: [2, 3] }],
    ["9f018202039f0405ffff", [1, [2, 3], [4, 5]]],
    ["7f657374726561646d696e67ff", "streaming"],
    ["c249010000000000000000", 2 ** 64],
  ])("%s", (hex, value) => expect(decodeCbor(bytes(hex))).toEqual(value));

  test("typed arrays of RFC 8746 are arrays of their own", () => {
    expect(decodeCbor(bytes("d855480000803f00000040"))).toEqual(Float32Array.of(1, 2));
    expect(decodeCbor(bytes("d84842ff01"))).toEqual(Int8Array.of(-1, 1));
  });

  test.each(["", "62c3", "9b00ffffffffffffff", "5f", "0000"])("%s is refused", (hex) => {
    expect(() => decodeCbor(bytes(hex))).toThrow();
  });

  test("a member named __proto__ changes no prototype", () => {
    const decoded = decodeCbor(bytes("a1695f5f70726f746f5f5fa1616101")) as object;
    expect(Object.getPrototypeOf(decoded)).toBe(Object.prototype);
  });

  test("arrays in arrays claim the bytes of a message once", () => {
    const claims = Array.from({ length: 100 }, () => [0x9a, 0x00, 0x00, 0x10, 0x00]).flat();
    const bytes = Uint8Array.from([...claims, ...new Array(5000).fill(0x00)]);
    expect(() => decodeCbor(bytes)).toThrow("an array is longer than the message");
    expect(decodeCbor(Uint8Array.of(0x82, 0x81, 0x00, 0x81, 0x00))).toEqual([[0], [0]]);
  });

  test("nesting has an end", () => {
    expect(() => decodeCbor(new Uint8Array(4000).fill(0x81))).toThrow("nested too deeply");
  });
});

describe("point clouds", () => {
  const fields = ["x", "y", "z", "rgb"].map((name, at) => ({ name, offset: 4 * at, datatype: 7 }));
  const cloud = (points: number[][], extra = {}) => {
    const view = new DataView(new ArrayBuffer(points.length * 16));
    points.forEach(([x = 0, y = 0, z = 0, rgb = 0], at) => {
      view.setFloat32(at * 16, x, true);
      view.setFloat32(at * 16 + 4, y, true);
      view.setFloat32(at * 16 + 8, z, true);
      view.setUint32(at * 16 + 12, rgb, true);
    });
    const data = new Uint8Array(view.buffer);
    const size = { width: points.length, height: 1, point_step: 16, row_step: 16 * points.length };
    return { ...size, is_bigendian: false, fields, data, ...extra };
  };

  test("places and colours", () => {
    const points = decodeCloud(cloud([[1, 2, 3, 0x102030]]));
    expect(points.positions).toEqual(Float32Array.of(1, 2, 3));
    expect(points.colors).toEqual(Uint8Array.of(0x10, 0x20, 0x30, 255));
  });

  test("points without a place are left out", () => {
    const points = decodeCloud(cloud([[Number.NaN], [4, 5, 6], [0, Number.POSITIVE_INFINITY]]));
    expect(points.count).toBe(1);
    expect(points.positions).toEqual(Float32Array.of(4, 5, 6));
  });

  test("without colours they go from blue to red by their intensity, or else by height", () => {
    const [blue, red] = [Uint8Array.of(70, 98, 217, 255), Uint8Array.of(203, 42, 4, 255)];
    const byHeight = decodeCloud(
      cloud(
        [
          [0, 0, 1],
          [0, 0, 5],
        ],
        { fields: fields.slice(0, 3) },
      ),
    ).colors;
    expect([byHeight.slice(0, 4), byHeight.slice(4)]).toEqual([blue, red]);
    const shaded = [...fields.slice(0, 3), { name: "intensity", offset: 8, datatype: 7 }];
    const byShade = decodeCloud(
      cloud(
        [
          [0, 0, 9],
          [0, 0, 2],
        ],
        { fields: shaded },
      ),
    ).colors;
    expect([byShade.slice(0, 4), byShade.slice(4)]).toEqual([red, blue]);
  });

  test("all points of a large one are there once, and the first of them are a sample of all", () => {
    const many = Array.from({ length: 10_007 }, (_, at) => [at]);
    const { count, positions } = decodeCloud(cloud(many));
    const places = Array.from({ length: count }, (_, at) => positions[at * 3] as number);
    expect([...places].sort((one, other) => one - other)).toEqual(many.map(([x]) => x));
    const sample = places.slice(0, 100).sort((one, other) => one - other);
    const gaps = sample.slice(1).map((x, at) => x - (sample[at] as number));
    expect(Math.max(...gaps)).toBeLessThan((3 * 10_007) / 100);
  });

  test("fewer octets than announced are fewer points", () => {
    expect(decodeCloud(cloud([[1], [2]], { width: 1000, row_step: 16000 })).count).toBe(2);
  });

  test("octets may come in base64", () => {
    const whole = cloud([[1, 2, 3]]);
    expect(decodeCloud({ ...whole, data: btoa(String.fromCharCode(...whole.data)) }).count).toBe(1);
  });

  test("fields that do not fit are refused", () => {
    const wide = { name: "x", offset: 14, datatype: 7 };
    expect(() => decodeCloud(cloud([[1]], { fields: [wide, ...fields.slice(1)] }))).toThrow("field x");
    expect(() => decodeCloud(cloud([[1]], { fields: [] }))).toThrow("no fields x and y");
  });
});

test.each([
  ["a part of a point", { width: 3000.5 }],
  ["no number", { height: Number.NaN }],
  ["less than none", { width: -1, height: -5000 }],
  ["no step of octets", { point_step: 0.5 }],
])("a cloud of %s is refused, as its points could never be counted", (_, wrong) => {
  const whole = { width: 5000, height: 1, point_step: 1, row_step: 5000, is_bigendian: false };
  const fields = ["x", "y"].map((name) => ({ name, offset: 0, datatype: 1 }));
  const cloud = { ...whole, fields, data: new Uint8Array(5000) };
  expect(decodeCloud(cloud).count).toBe(5000);
  expect(() => decodeCloud({ ...cloud, ...wrong })).toThrow("a cloud of");
});

describe("raw images", () => {
  const image = (encoding: string, step: number, data: number[]) => {
    return decodeImage({ width: 1, height: 1, encoding, step, is_bigendian: 0, data });
  };

  test.each([
    ["rgb8", [1, 2, 3]],
    ["bgr8", [3, 2, 1]],
    ["bgra8", [3, 2, 1, 9]],
  ])("%s", (encoding, data) => {
    expect([...image(encoding, data.length, data).rgba]).toEqual([1, 2, 3, 255]);
  });

  test("depth is stretched over its range, near is light", () => {
    const data = new Uint8Array(Float32Array.of(1, 2, Number.NaN).buffer);
    const { rgba } = decodeImage({ width: 3, height: 1, encoding: "32FC1", step: 12, is_bigendian: 0, data });
    expect([rgba[0], rgba[4], rgba[8]]).toEqual([255, 51, 0]);
  });

  test("what does not fit is refused", () => {
    expect(() => image("rgb8", 3, [1, 2])).toThrow("too few");
    expect(() => image("jpeg", 3, [1, 2, 3])).toThrow("jpeg");
    expect(() =>
      decodeImage({ width: 1e5, height: 1e5, encoding: "rgb8", step: 0, is_bigendian: 0, data: [] }),
    ).toThrow();
    const thin = { width: 1e300, height: 1e-300, encoding: "rgb8", step: 0, is_bigendian: 0 };
    expect(() => decodeImage({ ...thin, data: [1, 2, 3] })).toThrow("pixels");
  });
});

describe("messages that are too large", () => {
  const text = (op: string, topic: string, more = "") =>
    `{"op": "${op}", ${more}"topic": "${topic}", "msg": {"data": "${"x".repeat(200)}"}}`;
  // {"op": "publish", "topic": "/big", "msg": {"data": h'00…'}}
  const cbor = () => {
    const head = bytes("a3626f70677075626c69736865746f706963642f626967636d7367a16464617461590100");
    const whole = new Uint8Array(head.length + 256);
    whole.set(head);
    return whole.buffer;
  };

  test.each([[text("publish", "/big")], [text("publish", "/big", '"id": "a\\"b", ')], [cbor()]])(
    "are told by their first bytes, whatever follows",
    (message) => {
      setBound(100, new Set());
      expect(tooLarge(message)).toBe("/big");
      setBound(100, new Set(["/big"]));
      expect(tooLarge(message)).toBeNull();
      setBound(10_000, new Set());
      expect(tooLarge(message)).toBeNull();
    },
  );

  test.each([[text("service_response", "/big")], [`[${"1,".repeat(100)}1]`], ["{"]])(
    "are decoded where they are no message of a topic",
    (message) => {
      setBound(0, new Set());
      expect(tooLarge(message)).toBeNull();
    },
  );
});

type Vector = (typeof vectors)[number];

describe("compressed clouds", () => {
  const [first] = vectors as [Vector];
  const compressed = (
    { message }: Vector,
    change: (data: Uint8Array) => void = () => undefined,
  ): CompressedCloud => {
    const data = bytes(message.compressed_data);
    change(data);
    return { ...message, compressed_data: data };
  };

  test.each(vectors.map((vector) => [vector.name, vector] as const))("%s", (_, vector) => {
    expect(decompressCloud(compressed(vector))).toEqual(bytes(vector.data));
  });

  test.each([0, 4, 5, 6, 8, 12, 15, 16, 17, 46, 47, 50, 51])("a wrong octet %i is refused", (at) => {
    const damaged = compressed(first, (data) => {
      data[at] = 0xff;
    });
    expect(() => decompressCloud(damaged)).toThrow();
  });

  test("a cloud that claims to be too large is refused before anything is allocated", () => {
    expect(() => decompressCloud({ ...compressed(first), width: 2 ** 32 - 1 })).toThrow(/a cloud of/);
    expect(() => decompressCloud({ ...compressed(first), point_step: 4 })).toThrow(/does not fit/);
    const cut = { ...compressed(first), compressed_data: bytes(first.message.compressed_data).slice(0, -1) };
    expect(() => decompressCloud(cut)).toThrow();
  });

  test("the decoder is loaded with the first one, and other messages stay as they are", () => {
    const load = vi.fn(() => {
      self.decompressCloud = decompressCloud;
    });
    vi.stubGlobal("self", globalThis);
    vi.stubGlobal("CLOUD_PLANES", "planes.js");
    vi.stubGlobal("importScripts", load);
    const image = { format: "jpeg", data: "" };
    makeWhole(image);
    expect(image).toEqual({ format: "jpeg", data: "" });
    expect(load).not.toHaveBeenCalled();
    for (let round = 0; round < 2; round++) {
      const message: Record<string, unknown> = { ...compressed(first) };
      makeWhole(message);
      expect(message.data).toEqual(bytes(first.data));
      expect(message).not.toHaveProperty("format");
      expect(message).not.toHaveProperty("compressed_data");
    }
    expect(load.mock.calls).toEqual([["planes.js"]]);
    vi.unstubAllGlobals();
  });
});
