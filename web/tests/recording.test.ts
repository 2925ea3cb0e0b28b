import { McapWriter } from "@mcap/core";
import { beforeEach, describe, expect, test, vi } from "vitest";
import { decompressLz4 } from "../src/decode/lz4";
import { type FromWorker, PLAYBACK, type Playback, type ToWorker } from "../src/decode/protocol";
import { readMessage, rosTypes } from "../src/decode/ros_message";

const bytes = (hex: string) => Uint8Array.from(hex.match(/../g) ?? [], (pair) => Number.parseInt(pair, 16));

describe("messages, octet by octet", () => {
  const read = (definition: string, hex: string, isCdr = true, typed = false) =>
    readMessage(rosTypes("pkg/msg/Test", definition), "pkg/msg/Test", bytes(hex), isCdr, typed);

  test.each([
    ["uint8 a\nfloat64 b", "00010000 01 00000000000000 000000000000f03f", { a: 1, b: 1 }],
    ["uint8 a\nfloat64 b", "00070000 01 000000 000000000000f03f", { a: 1, b: 1 }],
    ["uint8 a\nint16 b", "00000000 01 00 fffe", { a: 1, b: -2 }],
    ["string a\nbool b", "00010000 03000000 6f6b00 01", { a: "ok", b: true }],
    ["int32[] a", "00010000 02000000 01000000 ffffffff", { a: [1, -1] }],
    ["int32[<=2] a\nint8[2] b", "00010000 01000000 01000000 ff02", { a: [1], b: [-1, 2] }],
    ["uint8[] a", "00010000 02000000 0102", { a: Uint8Array.of(1, 2) }],
    ["Other[] a\n===\nMSG: pkg/Other\nbool x", "00010000 02000000 0100", { a: [{ x: true }, { x: false }] }],
    ["builtin_interfaces/Time t", "00010000 01000000 02000000", { t: { sec: 1, nanosec: 2 } }],
    ["int32 LIMIT=3 # a constant\nstring NAME = 'a b'\nuint8 a 7", "00010000 05", { a: 5 }],
    ["int64 a", "00010000 ffffffffffffffff", { a: -1 }],
  ])("CDR of %j from %s", (definition, hex, message) =>
    expect(read(definition, hex.replaceAll(" ", ""))).toEqual(message),
  );

  test("the format of ROS 1 has no alignment, no terminator, and times of its own", () => {
    const hex = "01 01000000 6f 02000000 03000000 01000000 0000803f";
    const definition = "uint8 a\nstring b\ntime t\nfloat32[] c";
    const message = { a: 1, b: "o", t: { secs: 2, nsecs: 3 } };
    expect(read(definition, hex.replaceAll(" ", ""), false)).toEqual({ ...message, c: [1] });
    expect(read(definition, hex.replaceAll(" ", ""), false, true)).toEqual({
      ...message,
      c: Float32Array.of(1),
    });
  });

  test.each([
    ["int32 a", "00010000 0000"],
    ["uint8[] a", "00010000 ffffffff"],
    ["string[] a", "00010000 ffffffff"],
    ["Test a", "00010000"],
    ["Missing a", "00010000"],
    ["int32 a", "00090000 00000000"],
    ["float64[4000000000] a", "00010000 00000000"],
    ["bool[100000000] a", "00010000 00"],
  ])("%j of %s is refused", (definition, hex) => {
    expect(() => read(definition, hex.replaceAll(" ", ""))).toThrow();
  });

  test("whatever the octets, the work has an end", () => {
    const definition = "string[] a\nOther[] b\nfloat32[] c\n===\nMSG: pkg/Other\nstring[] x\nuint8[3] y";
    let seed = 1;
    const random = () => {
      seed = (seed * 48271) % 2147483647;
      return seed;
    };
    for (let round = 0; round < 3000; round++) {
      const octets = Uint8Array.from({ length: random() % 60 }, () => (random() % 3 ? 0 : random() % 256));
      octets.set([0, 1, 0, 0].slice(0, octets.length));
      try {
        readMessage(rosTypes("pkg/Test", definition), "pkg/Test", octets, true, false);
      } catch (error) {
        expect((error as Error).message).toMatch(/shorter|longer|Offset is outside|Invalid/);
      }
    }
  });
});

describe("LZ4", () => {
  const text = new TextEncoder().encode("robot web tools ".repeat(40));
  test.each([
    [
      "04224d186c4080020000000000002e1d000000ff01726f626f742077656220746f6f6c73201000ffff5a506f6f6c73200000000066fdb98c",
      text,
    ],
    [
      "04224d187040ad1d000000ff01726f626f742077656220746f6f6c73201000ffff5a506f6f6c7320725cebc200000000",
      text,
    ],
    [
      "04224d1860408228000080000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f202122232425262700000000",
      Uint8Array.from({ length: 40 }, (_, at) => at),
    ],
  ])("%s", (hex, content) => expect(decompressLz4(bytes(hex), content.length)).toEqual(content));

  test("a frame that is cut, changed or of another size is refused, or has other content", () => {
    const frame = bytes(
      "04224d186c4080020000000000002e1d000000ff01726f626f742077656220746f6f6c73201000ffff5a506f6f6c73200000000066fdb98c",
    );
    for (let length = 0; length < frame.length - 9; length++) {
      expect(() => decompressLz4(frame.slice(0, length), text.length)).toThrow();
    }
    expect(() => decompressLz4(frame, text.length - 1)).toThrow();
    for (let at = 0; at < frame.length; at++) {
      for (const value of [0, 1, 127, 255]) {
        const changed = frame.slice();
        changed[at] = value;
        try {
          expect(decompressLz4(changed, text.length)).toHaveLength(text.length);
        } catch (error) {
          expect(error).toBeInstanceOf(Error);
        }
      }
    }
  });
});

/** A recording of a number on /count, ten times a second for ten seconds, and of a name at its begin. */
async function recording(change: (content: Uint8Array) => Uint8Array = (content) => content): Promise<File> {
  const parts: Uint8Array[] = [];
  let size = 0;
  const writer = new McapWriter({
    chunkSize: 200,
    writable: {
      write: async (part) => {
        parts.push(part.slice());
        size += part.length;
      },
      position: () => BigInt(size),
    },
  });
  await writer.start({ profile: "ros2", library: "test" });
  const encoder = new TextEncoder();
  const topic = async (name: string, type: string, definition: string) => {
    const schemaId = await writer.registerSchema({
      name: type,
      encoding: "ros2msg",
      data: encoder.encode(definition),
    });
    return writer.registerChannel({
      schemaId,
      topic: name,
      messageEncoding: "cdr",
      metadata: new Map(),
    });
  };
  const name = await topic("/name", "std_msgs/msg/String", "string data");
  const count = await topic("/count", "std_msgs/msg/UInt8", "uint8 data");
  const broken = await topic("/broken", "std_msgs/msg/Int64", "int64 data");
  const add = (channelId: number, sequence: number, hex: string) => {
    const time = 1_000_000_000_000n + BigInt(sequence) * 100_000_000n;
    return writer.addMessage({ channelId, sequence, logTime: time, publishTime: time, data: bytes(hex) });
  };
  await add(name, 0, "00010000020000006100");
  for (let at = 0; at <= 100; at++) await add(count, at, `00010000${at.toString(16).padStart(2, "0")}`);
  await add(broken, 100, "00010000");
  await writer.end();
  const content = change(Uint8Array.from(parts.flatMap((part) => [...part])));
  return new File([content as BlobPart], "run.mcap");
}

describe("the worker that plays a recording", () => {
  let worker: { onmessage(event: { data: ToWorker }): void };
  let said: FromWorker[];

  beforeEach(async () => {
    said = [];
    worker = {
      onmessage: () => undefined,
      postMessage: (what: FromWorker) => {
        said.push(what);
        if (what.kind === "message" && what.mustTake)
          ask({ kind: "taken", topic: what.message.topic as string });
      },
    } as typeof worker;
    vi.stubGlobal("self", worker);
    vi.resetModules();
    await import("../src/decode/recording_worker");
  });

  const ask = (data: ToWorker) => worker.onmessage({ data });
  const send = (message: object) => ask({ kind: "send", socket: 1, text: JSON.stringify(message) });
  const begin = (file: File) => {
    ask({ kind: "file", file });
    ask({ kind: "open", socket: 1, url: "", protocols: [] });
  };
  const open = async () => {
    begin(await recording());
    await vi.waitFor(() => expect(said).toContainEqual({ kind: "open", socket: 1 }));
  };
  const published = (topic: string) =>
    said.flatMap((each) =>
      each.kind === "message" && each.message.op === "publish" && each.message.topic === topic
        ? [(each.message as unknown as { msg: Record<string, unknown> }).msg]
        : [],
    );
  const numbers = () => published("/count").map(({ data }) => data);
  const state = () => published(PLAYBACK).at(-1) as unknown as Playback;
  const play = (wanted: Partial<Playback>) =>
    send({ op: "call_service", id: "1", service: PLAYBACK, args: wanted });

  test("it answers as a robot with the recorded topics, and plays them in time", async () => {
    await open();
    send({ op: "call_service", id: "2", service: "/rosapi/topics", args: {} });
    expect(said.at(-1)).toMatchObject({
      message: {
        id: "2",
        result: true,
        values: {
          topics: ["/name", "/count", "/broken"],
          types: ["std_msgs/msg/String", "std_msgs/msg/UInt8", "std_msgs/msg/Int64"],
        },
      },
    });
    send({ op: "call_service", id: "3", service: "/drive", args: {} });
    expect(said.at(-1)).toMatchObject({ message: { id: "3", result: false } });
    play({ rate: 10 });
    send({ op: "subscribe", id: "4", topic: "/count" });
    send({ op: "subscribe", id: "5", topic: "/broken" });
    await vi.waitFor(() => expect(state()).toMatchObject({ begin: 1000, end: 1010, paused: true }), 10_000);
    expect(numbers()).toEqual([...numbers()].sort((one, other) => Number(one) - Number(other)));
    expect(new Set(numbers()).size).toBe(numbers().length);
    expect(published("/count").at(-1)).toEqual({ data: 100, $time: 1010 });
    // One that cannot be read is said once, by the name of its topic.
    const problems = said.filter((each) => each.kind === "message" && each.message.op === "status");
    expect(problems).toHaveLength(1);
    expect(JSON.stringify(problems)).toContain("recording:/broken:");
  });

  test("who subscribes later, or goes elsewhere, gets the last messages before", async () => {
    await open();
    play({ paused: true });
    await vi.waitFor(() => expect(state()?.paused).toBe(true));
    play({ time: 1005.05 });
    send({ op: "subscribe", id: "1", topic: "/count" });
    send({ op: "subscribe", id: "2", topic: "/name" });
    await vi.waitFor(() => expect(published("/name")).toHaveLength(1));
    expect(numbers()).toEqual([50]);
    expect(state()).toMatchObject({ time: 1005.05, paused: true });
    play({ time: 1002 });
    await vi.waitFor(() => expect(numbers()).toEqual([50, 20]));
    send({ op: "unsubscribe", id: "1", topic: "/count" });
    play({ time: 1003 });
    await vi.waitFor(() => expect(published("/name")).toHaveLength(3));
    expect(numbers()).toEqual([50, 20]);
    play({ time: -1e9 });
    await vi.waitFor(() => expect(state().time).toBe(1000));
  });

  test("it repeats, if asked to", async () => {
    await open();
    send({ op: "subscribe", id: "1", topic: "/count" });
    play({ rate: 100, loop: true });
    await vi.waitFor(
      () => expect(numbers().filter((each) => each === 100).length).toBeGreaterThan(1),
      10_000,
    );
    expect(state().paused).toBe(false);
  });

  test("what the page commands is dropped", async () => {
    await open();
    const before = said.filter(({ kind }) => kind !== "answering").length;
    send({ op: "advertise", topic: "/cmd_vel", type: "geometry_msgs/msg/Twist" });
    send({ op: "publish", topic: "/cmd_vel", msg: {} });
    expect(said.filter(({ kind }) => kind !== "answering")).toHaveLength(before);
  });

  test.each([
    ["an empty file", () => new Uint8Array()],
    ["no MCAP", () => new Uint8Array(1000)],
    ["a cut file", (content: Uint8Array) => content.slice(0, -100)],
    [
      "a file with another summary",
      (content: Uint8Array) => content.map((each, at) => (at === content.length - 60 ? each ^ 1 : each)),
    ],
  ])("%s is refused, with the reason", async (_, change) => {
    begin(await recording(change));
    await vi.waitFor(() =>
      expect(said).toContainEqual(expect.objectContaining({ kind: "close", code: 1006 })),
    );
    expect(said.find(({ kind }) => kind === "close")).toHaveProperty("reason", expect.stringMatching(/./));
  });
});
