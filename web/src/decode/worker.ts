/**
 * The worker that holds the WebSocket: it decodes what arrives, so that the page's thread is given objects and
 * typed arrays. Of topics that are decoded further only the newest message waits for the page.
 */

import { decodeCbor } from "./cbor";
import { decodeCloud, type PointCloud2 } from "./cloud";
import { decodeImage, type RawImage } from "./image";
import type { Decoding, FromWorker, ToWorker, Traffic } from "./protocol";

interface Envelope {
  op: string;
  topic?: string;
  msg?: Record<string, unknown>;
}

const sockets = new Map<number, WebSocket>();
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
      sockets.get(data.socket)?.send(data.text);
      break;
    case "close":
      sockets.get(data.socket)?.close();
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
  sockets.set(number, socket);
  socket.onopen = () => say({ kind: "open", socket: number });
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
      receive(number, message, typeof data === "string" ? data.length : data.byteLength);
    } catch (error) {
      say({ kind: "error", socket: number, text: `a message cannot be read: ${(error as Error).message}` });
    }
  };
}

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
      if (decoding === "cloud") message.msg.$points = decodeCloud(message.msg as unknown as PointCloud2);
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
