/** What a worker hands to the page. Of topics that are decoded further only the newest message waits for it. */

import { bytesOf } from "./bytes";
import { decodeCloud, type PointCloud2 } from "./cloud";
import { decodeImage, type RawImage } from "./image";
import { paletteOf } from "./palette";
import type { Decoding, FromWorker, Traffic } from "./protocol";
import { makeWhole } from "./whole_cloud";

/** A message of rosbridge. */
export interface Envelope {
  op: string;
  topic?: string;
  msg?: Record<string, unknown>;
}

/** Bytes of a decoded cloud that are handed on, to be read by people. */
const KEPT_BYTES = 1024;

let decodings = new Map<string, Decoding>();
let traffic = new Map<string, Traffic>();
let since = performance.now();
/** Topics of which the page has a message that it is not done with, and the newest one since. */
const waiting = new Map<string, { socket: number; message: Envelope } | null>();

export const say = (what: FromWorker, moved: Transferable[] = []) =>
  (self as unknown as { postMessage(what: FromWorker, moved: Transferable[]): void }).postMessage(
    what,
    moved,
  );

/** Decode messages of these topics further from now on. */
export function decodeFurther(wanted: Map<string, Decoding>): void {
  decodings = wanted;
}

/** The page is done with a message of a topic. */
export function taken(topic: string): void {
  const next = waiting.get(topic);
  waiting.delete(topic);
  if (next) deliver(next.socket, next.message);
}

/** The connection is closed: nothing waits for the page any more. */
export function forget(): void {
  waiting.clear();
}

/** Count a message of so many bytes, and hand it to the page. */
export function receive(socket: number, message: Envelope, bytes: number): void {
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
  if (message.op === "publish" && message.msg) {
    if (decoding) waiting.set(message.topic as string, null);
    try {
      const wasCompact = makeWhole(message.msg);
      if (decoding) decode(message.msg, decoding, wasCompact);
    } catch (error) {
      message.msg.$error = (error as Error).message;
    }
  }
  say({ kind: "message", socket, message: message as { op: string }, mustTake: decoding !== undefined }, [
    ...moved(message.msg, new Set()),
  ]);
}

function decode(message: Record<string, unknown>, decoding: Decoding, wasCompact: boolean): void {
  const [kind, palette, ...by] = decoding.split(":");
  if (kind === "cloud") {
    const cloud = message as unknown as PointCloud2;
    message.$points = { ...decodeCloud(cloud, by.join(":"), paletteOf(palette)), wasCompact };
    // The page has the points, and would keep all bytes of its last message.
    message.data = bytesOf(cloud.data).slice(0, KEPT_BYTES);
  } else message.$pixels = decodeImage(message as unknown as RawImage);
}

/** The buffers in a message that can change hands without a copy. */
function moved(value: unknown, found: Set<Transferable>): Set<Transferable> {
  if (ArrayBuffer.isView(value)) {
    found.add(value.buffer as ArrayBuffer);
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
