/** Messages that are too large to be decoded: their topic is told by their first bytes alone. */

import { membersBefore } from "./cbor";

/** Characters of a message that are searched for its topic. */
const HEAD = 4096;
const PUBLISHED =
  /^\s*\{\s*"op"\s*:\s*"publish"\s*,\s*(?:"id"\s*:\s*"(?:[^"\\]|\\.)*"\s*,\s*)?"topic"\s*:\s*("(?:[^"\\]|\\.)*")/;

let most = Number.POSITIVE_INFINITY;
let exempt: ReadonlySet<string> = new Set();

/** Decode messages of so many bytes at most from now on, and of some topics all. */
export function setBound(bytes: number, unbounded: ReadonlySet<string>): void {
  most = bytes;
  exempt = unbounded;
}

/** The topic of a message that is not to be decoded; null for one that is, also where its topic cannot be told. */
export function tooLarge(data: string | ArrayBuffer): string | null {
  const bytes = typeof data === "string" ? data.length : data.byteLength;
  if (bytes <= most) return null;
  const topic = typeof data === "string" ? topicOfText(data) : topicOfCbor(data);
  return topic === null || exempt.has(topic) ? null : topic;
}

function topicOfText(data: string): string | null {
  const [, topic] = PUBLISHED.exec(data.slice(0, HEAD)) ?? [];
  return topic === undefined ? null : (JSON.parse(topic) as string);
}

function topicOfCbor(data: ArrayBuffer): string | null {
  const { op, topic } = membersBefore(new Uint8Array(data), "msg");
  return op === "publish" && typeof topic === "string" ? topic : null;
}
