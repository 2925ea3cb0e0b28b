/** Pictures of a multipart stream (`multipart/x-mixed-replace`), as web_video_server sends them. */

/** One part of a stream. */
export interface Part {
  type: string;
  /** Seconds since 1970 by the robot's clock, where the server says so. */
  stamp: number;
  body: Uint8Array;
}

const MOST_HEADER = 8192;
const MOST_BODY = 32 * 1024 * 1024;
const text = new TextDecoder("latin1");

/** Splits what arrives in pieces into parts, by the length that each part announces. */
export class PartReader {
  private buffer = new Uint8Array(0);
  private used = 0;
  private header: { type: string; stamp: number; length: number } | null = null;

  /** The parts that are complete with these bytes. Throws where a part announces no sensible length. */
  push(bytes: Uint8Array): Part[] {
    this.append(bytes);
    const parts: Part[] = [];
    for (;;) {
      if (!this.header && !this.readHeader()) return parts;
      const header = this.header as { type: string; stamp: number; length: number };
      if (this.used < header.length) return parts;
      parts.push({ type: header.type, stamp: header.stamp, body: this.buffer.slice(0, header.length) });
      this.drop(header.length);
      this.header = null;
    }
  }

  private readHeader(): boolean {
    const shown = text.decode(this.buffer.subarray(0, Math.min(this.used, MOST_HEADER)));
    const end = shown.indexOf("\r\n\r\n");
    if (end < 0) {
      if (this.used > MOST_HEADER) throw new Error("a part of the stream has no end of its header");
      return false;
    }
    const field = (name: string) =>
      new RegExp(`^${name}:\\s*(.*)$`, "im").exec(shown.slice(0, end))?.[1]?.trim();
    const length = Number(field("Content-Length"));
    if (!(length >= 0 && length <= MOST_BODY)) throw new Error("a part of the stream has no length");
    this.header = {
      type: field("Content-Type") ?? "image/jpeg",
      stamp: Number(field("X-Timestamp") ?? Number.NaN),
      length,
    };
    this.drop(end + 4);
    return true;
  }

  private append(bytes: Uint8Array): void {
    if (this.used + bytes.length > this.buffer.length) {
      const larger = new Uint8Array(Math.max(this.buffer.length * 2, this.used + bytes.length));
      larger.set(this.buffer.subarray(0, this.used));
      this.buffer = larger;
    }
    this.buffer.set(bytes, this.used);
    this.used += bytes.length;
  }

  private drop(count: number): void {
    this.buffer.copyWithin(0, count, this.used);
    this.used -= count;
  }
}

/** Read a stream until `signal` ends it; every complete part is handed on. Throws where there is no stream. */
export async function readParts(
  url: URL,
  headers: Record<string, string>,
  onPart: (part: Part) => void,
  signal: AbortSignal,
): Promise<void> {
  const response = await fetch(url, { headers, signal });
  if (!response.ok || !response.body)
    throw new Error((await response.text()).trim() || `HTTP ${response.status}`);
  if (!response.headers.get("content-type")?.startsWith("multipart/"))
    throw new Error("the answer is no stream");
  const parts = new PartReader();
  const reader = response.body.getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    for (const part of parts.push(value)) onPart(part);
  }
}
