/** Pictures of a camera, by the best way that the robot has: WebRTC, else a stream over HTTP, else messages. */

import { effect, type Signal, signal } from "@preact/signals-core";
import { bytesOf } from "../decode/bytes";
import type { Pixels } from "../decode/protocol";
import { Delay } from "./delay";
import { readParts } from "./mjpeg";
import { seconds, shortType } from "./names";
import type { RobotSession } from "./session";
import type { Message } from "./subscriptions";
import { canWatch, WhepRefused, WhepViewer } from "./whep";

export const CAMERA_TYPES = ["sensor_msgs/Image", "sensor_msgs/CompressedImage"];

export type CameraWay = "webrtc" | "stream" | "compressed" | "raw";

/** Parameters of the MJPEG stream for each quality; the server adapts those of the first to the connection. */
export const CAMERA_QUALITIES = { auto: "", low: "&quality=40&width=320", high: "&quality=90" } as const;
export type CameraQuality = keyof typeof CAMERA_QUALITIES;

/** Choices of one viewer of a camera. */
export interface CameraOptions {
  quality?: CameraQuality;
  /** True if messages are preferred to a stream over HTTP, of which a browser opens six at a server. */
  messages?: boolean;
}

/** Milliseconds between two pictures that come as messages. */
const THROTTLE = 66;
/** Milliseconds that a stream has for its first picture: a browser asks a server for six things at a time, and no more. */
const FIRST = 15_000;
/** Milliseconds until a stream that broke off is asked for again. */
const AGAIN = 1000;
/** Frames over which the rate is counted. */
const WINDOW = 20;
/** Milliseconds that WebRTC has for its first picture before another way is begun beside it. */
const HEAD_START = 1000;
/** Milliseconds without a picture, or three times the usual, after which another way is begun beside it. */
const SILENCE = 2000;
/** Milliseconds until WebRTC is tried again, the first, second … time. */
const TRY_AGAIN = [5000, 15_000, 60_000];

/** Topics that are pictures for people; a depth cloud's encoded form is none, and depth comes last. */
export function cameraTopics(session: RobotSession): string[] {
  const rank = (name: string) =>
    (/depth/.test(name) ? 4 : 0) +
    (shortType(session.graph.value.topics.get(name) ?? "").endsWith("/Image") ? 0 : 1);
  return session
    .topicsOf(...CAMERA_TYPES)
    .filter((name) => !name.endsWith("/compressedDepth") && !/theora|ffmpeg/.test(name))
    .filter((name) => session.may("subscribe", name))
    .sort((one, other) => rank(one) - rank(other));
}

/**
 * One camera that is being looked at.
 *
 * WebRTC comes first where the server has it. Whenever it brings no pictures, be it that it is refused, finds no
 * path or falls silent, the other ways are begun beside it and end with its next picture; so there is no gap.
 */
export class Camera {
  /** Transport of the pictures; null until the first one. */
  readonly way: Signal<CameraWay | null> = signal(null);
  /** Pictures a second, over the last ones. */
  readonly rate = signal(0);
  /** When the last picture was taken, in milliseconds by this page's clock, as far as its stamp says; 0 before. */
  readonly takenAt = signal(0);
  /** Milliseconds by which the last picture was late, as far as its stamp says. */
  readonly latency = signal(0);
  readonly problem = signal("");

  private readonly arrivals: number[] = [];
  private delay = new Delay();
  private viewer: WhepViewer | null = null;
  private attempts = 0;
  /** Ends the wait for the next attempt by WebRTC. */
  private endWait = () => {};
  private silence: ReturnType<typeof setTimeout> | undefined;
  /** Ends the way beside WebRTC; null while there is none. */
  private end: (() => void) | null = null;
  private busy = false;
  private ended = false;

  /**
   * @param session the robot
   * @param topic of one of {@link CAMERA_TYPES}
   * @param show draws each picture, of a width and a height, before it returns
   * @param options choices of this viewer
   */
  constructor(
    private readonly session: RobotSession,
    private readonly topic: string,
    private readonly show: (picture: CanvasImageSource, width: number, height: number) => void,
    private readonly options: CameraOptions = {},
  ) {
    if (session.permissions.peek().has("whep") && canWatch()) this.watch();
    else this.besides();
  }

  /** Look no longer. */
  dispose(): void {
    this.ended = true;
    this.endWait();
    clearTimeout(this.silence);
    this.viewer?.close();
    this.end?.();
  }

  private watch(): void {
    this.expectPicture(HEAD_START);
    this.viewer = new WhepViewer(
      this.session,
      this.topic,
      (picture, width, height, time) => this.watched(picture, width, height, time),
      (error) => {
        this.viewer = null;
        clearTimeout(this.silence);
        if (this.ended) return;
        console.debug("no WebRTC:", error.message);
        this.besides();
        if (error instanceof WhepRefused && !error.isForNow) return;
        this.watchAgain();
      },
    );
  }

  /** Try WebRTC again after a while; while the robot does not answer at all, as soon as it does. */
  private watchAgain(): void {
    if (this.session.isAnswering) {
      const wait = TRY_AGAIN[Math.min(this.attempts++, TRY_AGAIN.length - 1)] as number;
      const timer = setTimeout(() => this.watch(), wait);
      this.endWait = () => clearTimeout(timer);
      return;
    }
    this.endWait = effect(() => {
      if (!this.session.isAnswering) return;
      this.endWait();
      this.watch();
    });
  }

  private watched(picture: CanvasImageSource, width: number, height: number, time: number): void {
    if (this.ended) return;
    this.end?.();
    this.end = null;
    this.attempts = 0;
    if (this.way.peek() !== "webrtc") this.arrivals.length = 0;
    this.comeBy("webrtc");
    this.problem.value = "";
    this.count(time, Number.NaN);
    this.expectPicture(Math.max(SILENCE, 3000 / (this.rate.peek() || 1)));
    this.show(picture, width, height);
  }

  private expectPicture(within: number): void {
    clearTimeout(this.silence);
    this.silence = setTimeout(() => this.besides(), within);
  }

  /** Begin another way, where there is none yet. */
  private besides(): void {
    if (this.end || this.ended) return;
    // The server's stream of a topic shows what the robot sees now, not what is in a recording.
    if (this.options.messages || this.session.isRecording) this.subscribe();
    else this.stream();
  }

  private stream(): void {
    const url = new URL("stream", this.session.httpBase);
    // web_video_server takes the topic as it is, without percent signs for the slashes.
    url.search = `?topic=${this.topic}&type=mjpeg${CAMERA_QUALITIES[this.options.quality ?? "auto"]}`;
    const control = new AbortController();
    const end = () => control.abort();
    this.end = end;
    let seen = false;
    const late = setTimeout(end, FIRST);
    const onPart = ({ type, body, stamp }: { type: string; body: Uint8Array; stamp: number }) => {
      seen = true;
      clearTimeout(late);
      this.comeBy("stream");
      void this.decode(() => new Blob([body as BlobPart], { type }), stamp);
    };
    readParts(url, this.session.httpHeaders, onPart, control.signal)
      .catch((error: Error) => {
        if (this.end === end) console.debug("no stream:", error.message);
      })
      .finally(() => {
        clearTimeout(late);
        if (this.ended || this.end !== end) return;
        if (!seen) {
          this.subscribe();
          return;
        }
        // It worked before: the server was started again, or the network was away.
        const timer = setTimeout(() => this.stream(), AGAIN);
        this.end = () => clearTimeout(timer);
      });
  }

  private subscribe(): void {
    const type = this.session.graph.peek().topics.get(this.topic) ?? "";
    const isCompressed = shortType(type) === "sensor_msgs/CompressedImage";
    const listener = (message: Message) => {
      this.comeBy(isCompressed ? "compressed" : "raw");
      const stamp = seconds((message.header as Message | undefined)?.stamp);
      if (typeof message.$error === "string") this.problem.value = message.$error;
      else if (message.$pixels) {
        const { width, height, rgba } = message.$pixels as Pixels;
        void this.decode(() => new ImageData(rgba as Uint8ClampedArray<ArrayBuffer>, width, height), stamp);
      } else if (isCompressed) {
        void this.decode(() => new Blob([bytesOf(message.data) as BlobPart]), stamp);
      }
    };
    this.end = this.session.subscribe(
      this.topic,
      type,
      listener,
      isCompressed ? { throttle: THROTTLE } : { throttle: THROTTLE, decoding: "image" },
    );
  }

  private async decode(source: () => ImageBitmapSource, stamp: number): Promise<void> {
    // A picture that comes while another is being decoded is passed over.
    if (this.busy || this.ended) return;
    this.busy = true;
    const arrived = this.session.robotTime / 1000;
    try {
      const picture = await createImageBitmap(source());
      // WebRTC may have taken over meanwhile.
      if (!this.ended && this.end) {
        this.problem.value = "";
        this.count(stamp, arrived);
        this.show(picture, picture.width, picture.height);
      }
      picture.close();
    } catch (error) {
      this.problem.value = (error as Error).message;
    } finally {
      this.busy = false;
    }
  }

  /** Each way has its own clock for the pictures, and its own delay. */
  private comeBy(way: CameraWay): void {
    if (this.way.peek() !== way) this.delay = new Delay();
    this.way.value = way;
  }

  /**
   * @param stamp of the picture in seconds, by the robot's clock or one of the way's own
   * @param robot seconds by the robot's clock when it arrived; NaN where the stamp is of another clock
   */
  private count(stamp: number, robot: number): void {
    const now = Date.now();
    const delay = this.delay.of(stamp, performance.now() / 1000, robot);
    this.arrivals.push(now);
    if (this.arrivals.length > WINDOW) this.arrivals.shift();
    const first = this.arrivals[0] as number;
    this.rate.value = now > first ? ((this.arrivals.length - 1) * 1000) / (now - first) : 0;
    // While a recording rests, its picture is of that time.
    this.takenAt.value = this.session.isRecording ? 0 : now - delay * 1000;
    this.latency.value = delay * 1000;
  }
}
