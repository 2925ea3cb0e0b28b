/** One subscription per topic, whatever number of panels look at it. */

import { type Ros, Topic } from "roslib";
import type { Decoding } from "../decode/protocol";
import { shortType } from "./names";

export type Message = Record<string, unknown>;
export type OnMessage = (message: Message) => void;

/** Options of one listener of a topic. */
export interface SubscribeOptions {
  /** Milliseconds between two messages at least; 0 for every message. */
  throttle?: number;
  /** Values that the worker computes from each message. */
  decoding?: Decoding;
  /** Every so many points of clouds are wanted; of several listeners the finest counts. */
  stride?: number;
}

interface Merged {
  type: string;
  throttle: number;
  stride: number;
  decoding: Decoding | undefined;
  topic: Topic<Message>;
  listeners: Map<OnMessage, SubscribeOptions>;
  /** Messages for later listeners: the last one, or the last one of each relevant publisher. */
  last: Map<string, Message>;
}

/** On which every publisher's last message counts: each tells of frames of its own (tf2's static broadcasters). */
const STATIC_FRAMES = "/tf_static";
/** Messages with other frames that are kept at most. */
const MOST_KEPT = 1000;

/** Return the key of a retained message, which a later one replaces. */
function keyOf(name: string, message: Message): string {
  if (name !== STATIC_FRAMES || !Array.isArray(message.transforms)) return "";
  return JSON.stringify(message.transforms.map((each) => String(each?.child_frame_id)).sort());
}

/** Types whose messages are mostly numbers or octets: JSON costs many times what CBOR does. */
const IN_CBOR = new Set([
  "sensor_msgs/PointCloud2",
  "sensor_msgs/Image",
  "sensor_msgs/CompressedImage",
  "sensor_msgs/LaserScan",
  "nav_msgs/OccupancyGrid",
  "map_msgs/OccupancyGridUpdate",
]);

/** Smaller form in which clouds are requested; servers without it send whole ones. The worker makes them whole. */
const COMPACT = { precision: 0.001, order: "any" };

/** Request clouds that the worker decodes in the smaller form, which roslib has no option for. */
function requestCompact(topic: Topic<Message>, stride: number): void {
  const call = topic.callForSubscribeAndAdvertise;
  topic.callForSubscribeAndAdvertise = (op) =>
    call(op.op === "subscribe" ? ({ ...op, compact: { ...COMPACT, stride } } as typeof op) : op);
}

function hand(name: string, message: Message, listener: OnMessage): void {
  try {
    listener(message);
  } catch (error) {
    // One panel's fault is not the others'.
    console.error(`a panel failed at a message on ${name}`, error);
  }
}

export class Subscriptions {
  private readonly topics = new Map<string, Merged>();

  /**
   * @param ros the connection, which subscribes again by itself after it was lost
   * @param onDecodings told when other topics are to be decoded further
   */
  constructor(
    private readonly ros: Ros,
    private readonly onDecodings: (decodings: Map<string, Decoding>) => void,
  ) {}

  /** The names of the topics that are subscribed to now. */
  get names(): string[] {
    return [...this.topics.keys()];
  }

  /**
   * Call `listener` with the messages of a topic, those that count of the past first: the last one, and of static frames the
   * last one of each publisher. A topic that several listeners
   * want is subscribed to once, as often as the most demanding of them wants.
   *
   * @returns what ends it
   */
  add(name: string, type: string, listener: OnMessage, options: SubscribeOptions = {}): () => void {
    const known = this.topics.get(name);
    const listeners = known?.listeners ?? new Map<OnMessage, SubscribeOptions>();
    listeners.set(listener, options);
    this.merge(name, type, listeners);
    if (known?.last.size) {
      queueMicrotask(() => {
        for (const message of known.last.values()) if (listeners.has(listener)) hand(name, message, listener);
      });
    }
    return () => {
      if (!listeners.delete(listener)) return;
      const merged = this.topics.get(name);
      if (merged?.listeners !== listeners) return;
      if (listeners.size) this.merge(name, merged.type, listeners);
      else {
        merged.topic.unsubscribe();
        this.topics.delete(name);
        if (merged.decoding) this.tellDecodings();
      }
    };
  }

  /** End the flow of a topic, whose listeners stay. */
  pause(name: string): void {
    this.topics.get(name)?.topic.unsubscribe();
  }

  /** Subscribe to a topic again that was paused. */
  resume(name: string): void {
    const merged = this.topics.get(name);
    if (!merged) return;
    this.topics.delete(name);
    this.merge(name, merged.type, merged.listeners);
  }

  private merge(name: string, type: string, listeners: Map<OnMessage, SubscribeOptions>): void {
    const options = [...listeners.values()];
    // Thinned out, several publishers' last messages, which come together, would be one.
    const throttle = name === STATIC_FRAMES ? 0 : Math.min(...options.map((each) => each.throttle ?? 0));
    // Of different wishes for the same topic the last one counts.
    const decoding = options.findLast((each) => each.decoding)?.decoding;
    const stride = Math.min(...options.map((each) => each.stride ?? 1));
    const known = this.topics.get(name);
    const isThinnedAlike = known?.stride === stride;
    if (known && known.throttle === throttle && known.decoding === decoding && isThinnedAlike) return;
    // A server that is asked for two forms at a time sends whole messages.
    if (!isThinnedAlike) known?.topic.unsubscribe();
    const topic = new Topic<Message>({
      ros: this.ros,
      name,
      messageType: type,
      throttle_rate: throttle,
      queue_length: throttle ? 1 : 0,
      compression: IN_CBOR.has(shortType(type)) ? "cbor" : "none",
    });
    if (decoding?.startsWith("cloud")) requestCompact(topic, stride);
    const merged: Merged = {
      type,
      throttle,
      stride,
      decoding,
      topic,
      listeners,
      last: known?.last ?? new Map(),
    };
    this.topics.set(name, merged);
    if (known?.decoding !== decoding) this.tellDecodings();
    topic.subscribe((message) => {
      const key = keyOf(name, message);
      merged.last.delete(key); // The newest is the last.
      merged.last.set(key, message);
      if (merged.last.size > MOST_KEPT) merged.last.delete(merged.last.keys().next().value as string);
      for (const listener of [...listeners.keys()]) hand(name, message, listener);
    });
    // The new subscription is there before the old one goes, so that nothing is missed.
    if (isThinnedAlike) known?.topic.unsubscribe();
  }

  private tellDecodings(): void {
    const decodings = new Map<string, Decoding>();
    for (const [name, { decoding }] of this.topics) if (decoding) decodings.set(name, decoding);
    this.onDecodings(decodings);
  }
}
