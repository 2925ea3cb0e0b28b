/** roslib's transport over a WebSocket that lives in the decoding worker. */

import type { ITransport, ITransportFactory } from "roslib";
import type { Answering } from "../decode/liveness";
import type { Decoding, FromWorker, ToWorker, Traffic } from "../decode/protocol";

type Listener = (event: never) => void;

/** Close code and reason of a connection. */
export interface Closed {
  code: number;
  reason: string;
}

/** The part of `Worker` that is used, so that tests can be one. */
export interface WorkerPort {
  postMessage(message: ToWorker): void;
  terminate(): void;
  onmessage: ((event: MessageEvent<FromWorker>) => void) | null;
  /** Told of a script that does not load, without a text, and of a fault in it. */
  onerror: ((event: { message?: string }) => void) | null;
}

type RosbridgeMessage = Parameters<ITransport["send"]>[0];

/** Part of JSON that TypeScript's library does not declare yet. */
const { rawJSON } = JSON as { rawJSON?: (text: string) => unknown };

/** A message as JSON, with all digits of 64-bit integers where the browser can write them. */
export function jsonOf(message: object): string {
  return JSON.stringify(message, (_, value: unknown) =>
    typeof value === "bigint" ? (rawJSON?.(String(value)) ?? Number(value)) : value,
  );
}

class WorkerTransport implements ITransport {
  private state: "connecting" | "open" | "closing" | "closed" = "connecting";
  private readonly listeners = new Map<string, Listener[]>();

  constructor(
    private readonly post: (message: ToWorker) => void,
    private readonly socket: number,
  ) {}

  on(event: string, listener: Listener): this {
    this.listeners.set(event, [...(this.listeners.get(event) ?? []), listener]);
    return this;
  }

  emit(event: "open" | "close" | "error" | "message", value: unknown): void {
    if (event === "open") this.state = "open";
    if (event === "close") this.state = "closed";
    for (const listener of this.listeners.get(event) ?? []) listener(value as never);
  }

  send(message: RosbridgeMessage): void {
    if (this.state === "open") {
      this.post({ kind: "send", socket: this.socket, text: jsonOf(message) });
    }
  }

  /** Send a message that is dropped if it would arrive late. */
  sendFresh(message: object): void {
    if (this.state === "open") {
      this.post({
        kind: "send",
        socket: this.socket,
        text: jsonOf(message),
        command: Date.now(),
      });
    }
  }

  close(): void {
    if (this.state === "closed") return;
    this.state = "closing";
    this.post({ kind: "close", socket: this.socket });
  }

  isConnecting = () => this.state === "connecting";
  isOpen = () => this.state === "open";
  isClosing = () => this.state === "closing";
  isClosed = () => this.state === "closed";
}

/** Callbacks of a session beside those of roslib. */
export interface Watcher {
  onTraffic(seconds: number, topics: Map<string, Traffic>): void;
  onAnswering(answering: Answering): void;
  onRefused(topic: string, bytes: number): void;
  onStatus(level: string, text: string, id: string | undefined): void;
}

/** Options of a connection. */
export interface Asking {
  /** Subprotocols of the WebSocket. */
  protocols: string[];
  /** Milliseconds until it has to be there. */
  patience: number;
}

/**
 * The page's end of the decoding worker. One worker serves all connections of a session, one after the other; one that
 * does not come to a connection, whatever the reason, is ended, and the next attempt has a new one.
 */
export class DecodeWorker {
  private count = 0;
  private current: [number, WorkerTransport] | null = null;
  private worker: WorkerPort | null = null;
  private bounds: Extract<ToWorker, { kind: "bound" }> | null = null;
  private decodings = new Map<string, Decoding>();
  private patience: ReturnType<typeof setTimeout> | undefined;
  private isEnding = false;

  /**
   * @param start starts the worker that runs `decode/worker.ts`
   * @param watcher is told of traffic and of the server's own `status` messages
   */
  constructor(
    private readonly start: () => WorkerPort,
    private readonly watcher: Watcher,
  ) {}

  /** Makes transports for roslib; `asking` tells how each time that a connection is opened. */
  factory(asking: () => Asking): ITransportFactory {
    return async (url) => {
      const socket = ++this.count;
      const { protocols, patience } = asking();
      this.worker ??= this.begin();
      const transport = new WorkerTransport((message) => this.worker?.postMessage(message), socket);
      this.current = [socket, transport];
      this.patience = setTimeout(() => this.giveUp(`no answer for ${patience / 1000} s`), patience);
      this.worker.postMessage({ kind: "open", socket, url, protocols });
      return transport;
    };
  }

  /** Say which topics are decoded further; the others are handed on as they are. */
  decode(decodings: Map<string, Decoding>): void {
    this.decodings = decodings;
    this.worker?.postMessage({ kind: "decodings", decodings });
  }

  /** Have messages of more bytes not decoded, but for those of some topics. */
  bound(bytes: number, unbounded: ReadonlySet<string>): void {
    this.bounds = { kind: "bound", bytes, unbounded };
    this.worker?.postMessage(this.bounds);
  }

  /** Send a message that is dropped, without a trace, if the robot does not answer or much waits to be sent. */
  sendFresh(message: object): void {
    this.current?.[1].sendFresh(message);
  }

  /** True if there is a connection, or an attempt to make one. */
  get isBusy(): boolean {
    return this.current !== null;
  }

  /** End the worker, once its connection is closed. */
  end(): void {
    this.isEnding = true;
    if (!this.current) this.drop();
  }

  private begin(): WorkerPort {
    const worker = this.start();
    worker.onmessage = ({ data }) => this.receive(data);
    worker.onerror = ({ message }) => {
      if (this.current?.[1].isConnecting()) this.giveUp(message || "its worker does not load");
      else this.watcher.onStatus("error", message || "the decoding worker failed", undefined);
    };
    worker.postMessage({ kind: "decodings", decodings: this.decodings });
    if (this.bounds) worker.postMessage(this.bounds);
    return worker;
  }

  /** End an attempt, and the worker with it: whatever it waits for is given up as well. */
  private giveUp(reason: string): void {
    this.drop();
    this.closed({ code: 1006, reason });
  }

  private drop(): void {
    if (this.worker) this.worker.onmessage = this.worker.onerror = null;
    this.worker?.terminate();
    this.worker = null;
  }

  private closed(how: Closed): void {
    const transport = this.current?.[1];
    clearTimeout(this.patience);
    this.current = null;
    transport?.emit("close", how);
    if (this.isEnding) this.drop();
  }

  private receive(data: FromWorker): void {
    if (data.kind === "traffic") {
      this.watcher.onTraffic(data.seconds, data.topics);
      return;
    }
    if (data.kind === "refused") {
      this.watcher.onRefused(data.topic, data.bytes);
      return;
    }
    if (this.current?.[0] !== data.socket) return;
    const transport = this.current[1];
    if (data.kind === "answering") {
      this.watcher.onAnswering(data);
    } else if (data.kind === "message") {
      const message = data.message as RosbridgeMessage & { level?: string; msg?: string; id?: string };
      if (message.op === "status") {
        this.watcher.onStatus(String(message.level), String(message.msg), message.id);
      }
      try {
        transport.emit("message", message);
      } finally {
        if (data.mustTake) this.worker?.postMessage({ kind: "taken", topic: data.message.topic as string });
      }
    } else if (data.kind === "open") {
      clearTimeout(this.patience);
      transport.emit("open", {});
    } else if (data.kind === "close") {
      this.closed({ code: data.code, reason: data.reason });
    } else {
      this.watcher.onStatus("error", data.text, undefined);
    }
  }
}
