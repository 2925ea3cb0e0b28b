/**
 * The worker that plays an MCAP file. To the page it is the server of a robot that publishes what was recorded, so
 * every panel shows it. It has no connection to anything: what the page publishes is dropped.
 *
 * Only the index of the file, and the chunks around the current time, are in memory.
 */

import { McapIndexedReader, type McapTypes } from "@mcap/core";
import { decompress } from "fzstd";
import { decodeFurther, receive, say, taken } from "./delivery";
import { decompressLz4 } from "./lz4";
import { PLAYBACK, type Playback, type ToWorker } from "./protocol";
import { readMessage, rosTypes } from "./ros_message";

type Message = McapTypes.TypedMcapRecords["Message"];
type Values = Record<string, unknown>;

interface Channel {
  topic: string;
  type: string;
  /** Throws where a message cannot be read. */
  read(bytes: Uint8Array, typed: boolean): Values;
}

/** What the page wants of a topic, by the ids of its subscriptions. */
type Wanted = Map<string, { throttle: number; typed: boolean }>;

/** Milliseconds between two steps, of work in one, and of the longest that is caught up with. */
const STEP = 30;
const WORK = 40;
const LONGEST = 250;
/** Bytes that are read or unpacked at a time, and of all chunks of the same time. */
const MOST_BYTES = 512 * 1024 * 1024;
/** Messages before the current time that a new subscriber gets: frames come in many messages. */
const EARLIER: Record<string, number> = { "/tf": 100, "/tf_static": 1000 };

const utf8 = new TextDecoder();
const inSeconds = (time: bigint) => Number(time / 1000n) / 1e6;

function withinLimit(size: bigint, what: string): number {
  if (size > BigInt(MOST_BYTES)) throw new Error(`${what} of ${size} bytes; at most ${MOST_BYTES} are read`);
  return Number(size);
}

function channelOf({ topic, messageEncoding }: McapTypes.Channel, schema?: McapTypes.Schema): Channel {
  const type = schema?.name ?? "";
  const encoding = `${messageEncoding} ${schema?.encoding ?? ""}`;
  let types: ReturnType<typeof rosTypes> | undefined;
  const read = (bytes: Uint8Array, typed: boolean): Values => {
    if (messageEncoding === "json") return JSON.parse(utf8.decode(bytes));
    if (!schema || !["cdr ros2msg", "ros1 ros1msg"].includes(encoding)) {
      throw new Error(`the encoding ${encoding} is not supported`);
    }
    types ??= rosTypes(type, utf8.decode(schema.data));
    return readMessage(types, type, bytes, messageEncoding === "cdr", typed);
  };
  return { topic, type, read };
}

class Player {
  private readonly channels: ReadonlyMap<number, Channel>;
  private readonly begin: bigint;
  private readonly end: bigint;
  /** Everything until this time has been handed to the page. */
  private time: bigint;
  private paused = false;
  private rate = 1;
  private loop = false;
  private sought: bigint | null = null;
  private readonly wanted = new Map<string, Wanted>();
  /** Topics whose earlier messages are wanted. */
  private readonly fresh = new Set<string>();
  private readonly sentAt = new Map<string, number>();
  /** Channels whose messages cannot be read: said once. */
  private readonly unreadable = new Set<number>();
  private messages: AsyncGenerator<Message, void, void> | null = null;
  private next: Message | null = null;
  /** Told when the page has seen the last state. */
  onShown: () => void = () => undefined;

  constructor(
    private readonly reader: McapIndexedReader,
    private readonly socket: number,
  ) {
    const { chunkIndexes, channelsById, schemasById } = reader;
    if (!chunkIndexes.length) throw new Error("the file has no chunks with messages");
    const least = (one: bigint, other: bigint) => (one < other ? one : other);
    this.begin = chunkIndexes.map((each) => each.messageStartTime).reduce(least);
    this.end = -chunkIndexes.map((each) => -each.messageEndTime).reduce(least);
    this.time = this.begin;
    this.channels = new Map(
      [...channelsById].map(([id, each]) => [id, channelOf(each, schemasById.get(each.schemaId))]),
    );
    // All chunks of one time are in memory together.
    const edges = chunkIndexes.flatMap(({ messageStartTime, messageEndTime, uncompressedSize }) => [
      { time: messageStartTime, change: uncompressedSize },
      { time: messageEndTime + 1n, change: -uncompressedSize },
    ]);
    edges.sort((one, other) => (one.time < other.time ? -1 : one.time > other.time ? 1 : 0));
    let size = 0n;
    for (const { change } of edges) {
      size += change;
      withinLimit(size, "chunks of the same time");
    }
  }

  private complain(about: string, error: unknown): void {
    const text = `${about}: ${(error as Error).message}`;
    const status = { op: "status", level: "error", msg: text, id: `recording:${about}:` };
    say({ kind: "message", socket: this.socket, message: status, mustTake: false });
  }

  /** A request of the page, in rosbridge's JSON. */
  take(request: Values): void {
    const topic = String(request.topic);
    const id = String(request.id);
    if (topic === PLAYBACK) return;
    if (request.op === "subscribe") {
      const wanted: Wanted = this.wanted.get(topic) ?? new Map();
      wanted.set(id, { throttle: Number(request.throttle_rate ?? 0), typed: request.compression === "cbor" });
      this.wanted.set(topic, wanted);
      this.fresh.add(topic);
    } else if (request.op === "unsubscribe") {
      this.wanted.get(topic)?.delete(id);
      if (!this.wanted.get(topic)?.size) this.wanted.delete(topic);
    } else if (request.op === "call_service") {
      const values = this.answer(String(request.service), (request.args ?? {}) as Partial<Playback>);
      const message = { op: "service_response", id, service: request.service, result: values !== null };
      const answer = { ...message, values: values ?? "a recording has no services" };
      say({ kind: "message", socket: this.socket, message: answer, mustTake: false });
    }
  }

  /** The answer of a service; null where there is none of that name. */
  private answer(service: string, wanted: Partial<Playback>): object | null {
    const types = new Map([...this.channels.values()].map(({ topic, type }) => [topic, type]));
    switch (service) {
      case "/rosapi/topics":
        return { topics: [...types.keys()], types: [...types.values()] };
      case "/rosapi/services":
        return { services: [] };
      case "/rosapi/get_ros_version":
        return { version: this.reader.header.profile === "ros1" ? 1 : 2, distro: "" };
      case PLAYBACK: {
        const { time, paused, rate, loop } = wanted;
        if (time !== undefined) this.seek(BigInt(Math.round(time * 1e6)) * 1000n);
        if (paused === false && this.time >= this.end) this.seek(this.begin);
        this.paused = paused ?? this.paused;
        this.rate = rate ?? this.rate;
        this.loop = loop ?? this.loop;
        return this.state;
      }
      default:
        return null;
    }
  }

  private seek(time: bigint): void {
    this.sought = time < this.begin ? this.begin : time > this.end ? this.end : time;
  }

  private get state(): Playback {
    const { paused, rate, loop } = this;
    const [begin, end, time] = [this.begin, this.end, this.sought ?? this.time].map(inSeconds);
    return { begin, end, time, paused, rate, loop } as Playback;
  }

  /** Play for as long as the worker lives. */
  async run(): Promise<void> {
    for (let before = performance.now(); ; ) {
      const now = performance.now();
      const elapsed = Math.min(now - before, LONGEST);
      before = now;
      try {
        await this.step(elapsed, now + WORK);
      } catch (error) {
        // A chunk that cannot be read: others may.
        this.messages = this.next = null;
        this.paused = true;
        this.complain("", error);
      }
      const clockOffset = inSeconds(this.time) * 1000 - Date.now();
      say({ kind: "answering", socket: this.socket, silence: 0, clockOffset, trip: 0 });
      const shown = new Promise<void>((resolve) => {
        this.onShown = resolve;
      });
      const message = { op: "publish", topic: PLAYBACK, msg: this.state };
      say({ kind: "message", socket: this.socket, message, mustTake: true });
      // The page shows what it has before there is more.
      await shown;
      await new Promise((later) => setTimeout(later, STEP));
    }
  }

  private async step(elapsed: number, until: number): Promise<void> {
    if (this.sought !== null) {
      [this.time, this.sought] = [this.sought, null];
      for (const topic of this.wanted.keys()) this.fresh.add(topic);
    }
    if (this.fresh.size) {
      this.messages = this.next = null;
      for (const topic of this.fresh) {
        this.fresh.delete(topic);
        await this.sendEarlier(topic);
      }
    }
    if (this.paused) return;
    const goal = this.time + BigInt(Math.round(elapsed * 1e6 * this.rate));
    const target = goal < this.end ? goal : this.end;
    this.messages ??= this.reader.readMessages({
      topics: [...this.wanted.keys()],
      startTime: this.time + 1n,
    });
    for (;;) {
      this.next ??= (await this.messages.next()).value ?? null;
      if (!this.next || this.next.logTime > target) break;
      // Late: the recording goes on more slowly.
      if (this.next.logTime > this.time && (performance.now() > until || this.sought !== null)) return;
      this.time = this.next.logTime;
      this.send(this.next);
      this.next = null;
    }
    this.time = target;
    if (target < this.end) return;
    if (this.loop) this.seek(this.begin);
    else this.paused = true;
  }

  /** Send the last messages of a topic before the current time. */
  private async sendEarlier(topic: string): Promise<void> {
    const found: Message[] = [];
    const most = EARLIER[topic] ?? 1;
    for await (const message of this.reader.readMessages({
      topics: [topic],
      endTime: this.time,
      reverse: true,
    })) {
      if (found.push(message) >= most) break;
    }
    this.sentAt.delete(topic);
    for (const message of found.reverse()) this.send(message, true);
  }

  private send({ channelId, logTime, data }: Message, isEarlier = false): void {
    const channel = this.channels.get(channelId);
    const wanted = channel && this.wanted.get(channel.topic);
    if (!wanted) return;
    const { topic } = channel;
    const options = [...wanted.values()];
    const now = performance.now();
    const throttle = Math.min(...options.map((each) => each.throttle));
    if (!isEarlier && now - (this.sentAt.get(topic) ?? Number.NEGATIVE_INFINITY) < throttle) return;
    this.sentAt.set(topic, now);
    try {
      const message = channel.read(
        data,
        options.some((each) => each.typed),
      );
      const msg = { ...message, $time: inSeconds(logTime) };
      receive(this.socket, { op: "publish", topic, msg }, data.length);
    } catch (error) {
      if (!this.unreadable.has(channelId)) this.complain(topic, error);
      this.unreadable.add(channelId);
    }
  }
}

let file = new Blob();
let player: Player | null = null;

async function open(socket: number): Promise<void> {
  const readable = {
    size: async () => BigInt(file.size),
    read: async (from: bigint, size: bigint) => {
      const until = Number(from) + withinLimit(size, "a part");
      if (until > file.size) throw new Error("the file is cut");
      return new Uint8Array(await file.slice(Number(from), until).arrayBuffer());
    },
  };
  const decompressHandlers = {
    zstd: (bytes: Uint8Array, size: bigint) =>
      decompress(bytes, new Uint8Array(withinLimit(size, "a chunk"))),
    lz4: (bytes: Uint8Array, size: bigint) => decompressLz4(bytes, withinLimit(size, "a chunk")),
  };
  try {
    player = new Player(await McapIndexedReader.Initialize({ readable, decompressHandlers }), socket);
  } catch (error) {
    say({ kind: "close", socket, code: 1006, reason: (error as Error).message });
    return;
  }
  say({ kind: "open", socket });
  void player.run();
}

self.onmessage = ({ data }: MessageEvent<ToWorker>) => {
  if (data.kind === "file") file = data.file;
  else if (data.kind === "open") void open(data.socket);
  else if (data.kind === "send") player?.take(JSON.parse(data.text));
  else if (data.kind === "decodings") decodeFurther(data.decodings);
  else if (data.kind === "close") say({ kind: "close", socket: data.socket, code: 1000, reason: "" });
  else if (data.kind === "taken") {
    if (data.topic === PLAYBACK) player?.onShown();
    else taken(data.topic);
  }
};
