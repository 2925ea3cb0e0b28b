/** Messages between the page and its decoding worker. */

import type { Answering } from "./liveness";
import type { Palette } from "./palette";

/** Values that the worker computes from a topic's messages; of a cloud with the palette and the field of its colours. */
export type Decoding = "image" | "cloud" | `cloud:${Palette}:${string}`;

/** The points of a cloud, as a renderer takes them. The first of many are a sample of all. */
export interface Points {
  count: number;
  /** x, y and z of each, in metres, in the frame of the cloud. */
  positions: Float32Array;
  /** Red, green, blue and opacity of each, 0 to 255, as a screen shows them. */
  colors: Uint8Array;
  /** Names of the fields that the cloud has. */
  fields: string[];
  /** Field that the colours show, and its least and greatest value; null where it is a colour itself. */
  by: string;
  range: [least: number, most: number] | null;
  /** True if the server sent the smaller form, in which it sends as few points as are wanted. */
  wasCompact?: boolean;
}

/** Pixels of a raw image, as a canvas takes them. */
export interface Pixels {
  width: number;
  height: number;
  /** Red, green, blue and opacity of each pixel. */
  rgba: Uint8ClampedArray;
}

/** Topic on which the worker that plays a recording says where it is, and service by which it is told where to go. */
export const PLAYBACK = "$playback";

/** State of a recording that is played; times in seconds since 1970. */
export interface Playback {
  begin: number;
  end: number;
  time: number;
  paused: boolean;
  /** Seconds of the recording for each second. */
  rate: number;
  loop: boolean;
}

export type ToWorker =
  /** The recording that the worker is to play. */
  | { kind: "file"; file: Blob }
  | { kind: "open"; socket: number; url: string; protocols: string[] }
  /** `command`: when the command or sample was made, in milliseconds since 1970; it is dropped if it would be late. */
  | { kind: "send"; socket: number; text: string; command?: number }
  | { kind: "close"; socket: number }
  /** Which topics are decoded further. */
  | { kind: "decodings"; decodings: Map<string, Decoding> }
  /** Messages of more bytes are not decoded, but for those of some topics. */
  | { kind: "bound"; bytes: number; unbounded: ReadonlySet<string> }
  /** The page is done with a message of a topic of which only the newest counts. */
  | { kind: "taken"; topic: string };

/** Messages and bytes of a topic that arrived in the last second. */
export interface Traffic {
  messages: number;
  bytes: number;
}

export type FromWorker =
  | { kind: "open"; socket: number }
  | { kind: "close"; socket: number; code: number; reason: string }
  | { kind: "error"; socket: number; text: string }
  /** Responsiveness, sent on change, and ten times a second while the robot does not answer. */
  | ({ kind: "answering"; socket: number } & Answering)
  | { kind: "message"; socket: number; message: { op: string; topic?: string }; mustTake: boolean }
  /** A message that was not decoded, because of its size. */
  | { kind: "refused"; topic: string; bytes: number }
  | { kind: "traffic"; seconds: number; topics: Map<string, Traffic> };
