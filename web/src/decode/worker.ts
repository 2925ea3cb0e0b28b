/**
 * The worker that holds the WebSocket: it decodes what arrives, so that the page's thread is given objects and
 * typed arrays. Of topics that are decoded further only the newest message waits for the page.
 */

import { decodeCbor } from "./cbor";
import { decodeCloud, type PointCloud2 } from "./cloud";
import { decodeImage, type RawImage } from "./image";
import { type Answering, GIVE_UP, Liveness, SILENT } from "./liveness";
import { paletteOf } from "./palette";
import type { Decoding, FromWorker, ToWorker, Traffic } from "./protocol";

interface Envelope {
  op: string;
  topic?: string;
  msg?: Record<string, unknown>;
}

interface Connection {
  socket: WebSocket;
  /** Null until the connection is open. */
  liveness: Liveness | null;
  answering: Answering;
}

/** Milliseconds between two looks at whether the robot answers. */
const LOOK = 100;
/** Bytes that wait in the browser above which commands and samples are dropped: they would arrive late. */
const MOST_WAITING = 64 * 1024;

const sockets = new Map<number, Connection>();
let decodings = new Map<string, Decoding>();
let traffic = new Map<string, Traffic>();
let since = performance.now();
/** Topics of which the page has a message that it is not done with, and the newest one since. */
const waiting = new Map<string, { socket: number; message: Envelope } | null>();

const say = (what: FromWorker, moved: Transferable[] = []) =>
  (self as unknown as { postMessage(what: FromWorker, moved: Transferable[]): void }).postMessage(
    what,
    moved,
  );

self.onmessage = ({ data }: MessageEvent<ToWorker>) => {
  switch (data.kind) {
    case "open":
      open(data.socket, data.url, data.protocols);
      break;
    case "send":
      send(data.socket, data.text, data.command);
      break;
    case "close":
      sockets.get(data.socket)?.socket.close();
      break;
    case "decodings":
      decodings = data.decodings;
      break;
    case "taken": {
      const next = waiting.get(data.topic);
      waiting.delete(data.topic);
      if (next) deliver(next.socket, next.message);
      break;
    }
  }
};

function open(number: number, url: string, protocols: string[]): void {
  let socket: WebSocket;
  try {
    socket = new WebSocket(url, protocols);
  } catch (error) {
    say({ kind: "close", socket: number, code: 1006, reason: String(error) });
    return;
  }
  socket.binaryType = "arraybuffer";
  const connection: Connection = {
    socket,
    liveness: null,
    answering: { silence: 0, clockOffset: 0, trip: 0 },
  };
  sockets.set(number, connection);
  socket.onopen = () => {
    connection.liveness = new Liveness(performance.now());
    say({ kind: "open", socket: number });
  };
  socket.onclose = ({ code, reason }) => {
    sockets.delete(number);
    waiting.clear();
    say({ kind: "close", socket: number, code, reason });
  };
  socket.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => {
    try {
      const message = (
        typeof data === "string" ? JSON.parse(data) : decodeCbor(new Uint8Array(data))
      ) as Envelope;
      if (typeof message?.op !== "string") throw new Error("a message without `op`");
      if (connection.liveness?.hear(message as { op: string }, performance.now(), Date.now())) {
        look(number, connection);
        return;
      }
      receive(number, message, typeof data === "string" ? data.length : data.byteLength);
    } catch (error) {
      say({ kind: "error", socket: number, text: `a message cannot be read: ${(error as Error).message}` });
    }
  };
}

function send(number: number, text: string, command?: number): void {
  const connection = sockets.get(number);
  if (!connection) return;
  if (command !== undefined) {
    const { socket, liveness } = connection;
    const isLate =
      Date.now() - command > SILENT ||
      socket.bufferedAmount > MOST_WAITING ||
      (liveness?.answering(performance.now()).silence ?? 0) > 0;
    if (isLate) return;
  }
  connection.socket.send(text);
}

/** Send a beat if one is due, and tell the page how the robot answers. */
function look(number: number, connection: Connection): void {
  const { socket, liveness, answering: before } = connection;
  if (!liveness || socket.readyState !== WebSocket.OPEN) return;
  const now = performance.now();
  const beat = liveness.beat(now);
  if (beat) socket.send(beat);
  const answering = liveness.answering(now);
  connection.answering = answering;
  // The clock is told to the millisecond: the page has no use for more.
  const isNews =
    answering.silence !== before.silence ||
    Math.abs(answering.clockOffset - before.clockOffset) >= 1 ||
    Math.abs(answering.trip - before.trip) >= 1;
  if (isNews) say({ kind: "answering", socket: number, ...answering });
  if (!liveness.isDead(now)) return;
  // A lost network: the system would retry ever less often, and take as long again to notice that it is back.
  socket.onclose = socket.onmessage = null;
  socket.close();
  sockets.delete(number);
  waiting.clear();
  say({ kind: "close", socket: number, code: 1006, reason: `no answer for ${GIVE_UP / 1000} s` });
}

setInterval(() => {
  for (const [number, connection] of sockets) look(number, connection);
}, LOOK);

function receive(socket: number, message: Envelope, bytes: number): void {
  if (message.op === "publish" && message.topic !== undefined) {
    const counted = traffic.get(message.topic);
    if (counted) {
      counted.messages++;
      counted.bytes += bytes;
    } else {
      traffic.set(message.topic, { messages: 1, bytes });
    }
    if (waiting.has(message.topic)) {
      waiting.set(message.topic, { socket, message });
      return;
    }
  }
  deliver(socket, message);
}

function deliver(socket: number, message: Envelope): void {
  const decoding = message.op === "publish" ? decodings.get(message.topic as string) : undefined;
  if (decoding && message.msg) {
    waiting.set(message.topic as string, null);
    try {
      const [kind, palette, ...by] = decoding.split(":");
      if (kind === "cloud")
        message.msg.$points = decodeCloud(
          message.msg as unknown as PointCloud2,
          by.join(":"),
          paletteOf(palette),
        );
      else message.msg.$pixels = decodeImage(message.msg as unknown as RawImage);
    } catch (error) {
      message.msg.$error = (error as Error).message;
    }
  }
  say(
    { kind: "message", socket, message: message as { op: string }, mustTake: decoding !== undefined },
    moved(message.msg, []),
  );
}

/** The buffers in a message that can change hands without a copy. */
function moved(value: unknown, found: Transferable[]): Transferable[] {
  if (ArrayBuffer.isView(value)) {
    if (!found.includes(value.buffer as ArrayBuffer)) found.push(value.buffer as ArrayBuffer);
  } else if (Array.isArray(value)) {
    if (typeof value[0] === "object") for (const item of value) moved(item, found);
  } else if (value !== null && typeof value === "object") {
    for (const item of Object.values(value)) moved(item, found);
  }
  return found;
}

setInterval(() => {
  const now = performance.now();
  say({ kind: "traffic", seconds: (now - since) / 1000, topics: traffic });
  since = now;
  traffic = new Map();
}, 1000);
