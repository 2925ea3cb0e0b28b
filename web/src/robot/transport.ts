/** roslib's transport over a WebSocket that lives in the decoding worker. */

import type { ITransport, ITransportFactory } from "roslib";
import type { Decoding, FromWorker, ToWorker, Traffic } from "../decode/protocol";

type Listener = (event: never) => void;

/** How a connection ended, as WebSocket says it. */
export interface Closed {
  code: number;
  reason: string;
}

/** The part of `Worker` that is used, so that tests can be one. */
export interface WorkerPort {
  postMessage(message: ToWorker): void;
  onmessage: ((event: MessageEvent<FromWorker>) => void) | null;
}

type RosbridgeMessage = Parameters<ITransport["send"]>[0];

class WorkerTransport implements ITransport {
  private state: "connecting" | "open" | "closing" | "closed" = "connecting";
  private readonly listeners = new Map<string, Listener[]>();

  constructor(
    private readonly worker: WorkerPort,
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
      this.worker.postMessage({ kind: "send", socket: this.socket, text: JSON.stringify(message) });
    }
  }

  close(): void {
    if (this.state === "closed") return;
    this.state = "closing";
    this.worker.postMessage({ kind: "close", socket: this.socket });
  }

  isConnecting = () => this.state === "connecting";
  isOpen = () => this.state === "open";
  isClosing = () => this.state === "closing";
  isClosed = () => this.state === "closed";
}

/** What a session is told beside what roslib tells it. */
export interface Watcher {
  onTraffic(seconds: number, topics: Map<string, Traffic>): void;
  onStatus(level: string, text: string, id: string | undefined): void;
}

/** The page's end of the decoding worker. One worker serves all connections of a session. */
export class DecodeWorker {
  private count = 0;
  private current: [number, WorkerTransport] | null = null;

  /**
   * @param worker the worker that runs `decode/worker.ts`
   * @param watcher is told of traffic and of the server's own `status` messages
   */
  constructor(
    private readonly worker: WorkerPort,
    private readonly watcher: Watcher,
  ) {
    worker.onmessage = ({ data }) => this.receive(data);
  }

  /** Makes transports for roslib; `protocols` are asked for when each connection is opened. */
  factory(protocols: () => string[]): ITransportFactory {
    return async (url) => {
      const socket = ++this.count;
      const transport = new WorkerTransport(this.worker, socket);
      this.current = [socket, transport];
      this.worker.postMessage({ kind: "open", socket, url, protocols: protocols() });
      return transport;
    };
  }

  /** Say which topics are decoded further; the others are handed on as they are. */
  decode(decodings: Map<string, Decoding>): void {
    this.worker.postMessage({ kind: "decodings", decodings });
  }

  private receive(data: FromWorker): void {
    if (data.kind === "traffic") {
      this.watcher.onTraffic(data.seconds, data.topics);
      return;
    }
    if (this.current?.[0] !== data.socket) return;
    const transport = this.current[1];
    if (data.kind === "message") {
      const message = data.message as RosbridgeMessage & { level?: string; msg?: string; id?: string };
      if (message.op === "status") {
        this.watcher.onStatus(String(message.level), String(message.msg), message.id);
      }
      try {
        transport.emit("message", message);
      } finally {
        if (data.mustTake) this.worker.postMessage({ kind: "taken", topic: data.message.topic as string });
      }
    } else if (data.kind === "open") {
      transport.emit("open", {});
    } else if (data.kind === "close") {
      transport.emit("close", { code: data.code, reason: data.reason } satisfies Closed);
    } else {
      this.watcher.onStatus("error", data.text, undefined);
    }
  }
}
