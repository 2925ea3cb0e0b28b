/** One robot: its connection, which is made again when it is lost, what it offers, and what may be done with it. */

import { computed, type ReadonlySignal, type Signal, signal } from "@preact/signals-core";
import { Ros, Service } from "roslib";
import type { Traffic } from "../decode/protocol";
import { Commands } from "./commands";
import type { GoalHandle } from "./goals";
import { shortType } from "./names";
import { askPermissions, Permissions } from "./permissions";
import { Rates } from "./rates";
import { type Message, type OnMessage, type SubscribeOptions, Subscriptions } from "./subscriptions";
import { type Closed, DecodeWorker, type WorkerPort } from "./transport";
import { Definitions, type RosapiTypeDef } from "./typedefs";

export type ConnectionState = "connecting" | "open" | "lost" | "refused";

/** Names that the robot offers; types as the robot writes them. */
export interface Graph {
  topics: ReadonlyMap<string, string>;
  services: readonly string[];
  actions: readonly string[];
  nodes: readonly string[];
  /** Why it is not known; empty where it is. */
  problem: string;
}

/** Something that the server, or this page, has to say. */
export interface Notice {
  number: number;
  level: "error" | "warning" | "info";
  text: string;
  /** The topic, service or action that it is about, where that is known. */
  about: string;
  /** Number of repetitions, also with other numbers in the text. */
  count: number;
  /** Milliseconds since 1970 of the last time. */
  at: number;
}

export interface SessionOptions {
  /** The WebSocket URL of the robot. */
  url: string;
  token?: string;
  /** Starts the decoding worker. */
  worker: () => WorkerPort;
  /** Milliseconds between two looks at what the robot offers. */
  discovery?: number;
  /** Bytes of a message above which its topic is not shown; all are by default. */
  messageBytes?: number;
  /** True if the worker plays a recording: there is no robot, and nothing is sent. */
  isRecording?: boolean;
}

const EMPTY: Graph = { topics: new Map(), services: [], actions: [], nodes: [], problem: "" };
const MOST_NOTICES = 50;
/** Milliseconds to wait before the first, second … attempt to connect again. */
const BACKOFF = [250, 500, 1000, 2000, 4000];
/** Milliseconds that the first, second … attempt to connect may take: on a busy machine each has more than the last. */
const CONNECT = [10_000, 20_000, 40_000];
const PATIENCE = 10_000;
/** Milliseconds to wait for what the server says about roles before anything else is asked for. */
const ROLE_FIRST = 5000;
/** Milliseconds for the server to say why it refuses a connection. */
const WHY = 5000;

/** A call that the robot refused, or that could not be made; the text is for people. */
export class RobotError extends Error {}

export class RobotSession {
  readonly url: string;
  /** True if no robot is behind it but a recording. */
  readonly isRecording: boolean;
  /** Where the same server is asked over HTTP, with a slash at its end. */
  readonly httpBase: string;
  /** Other origins that meshes and textures may come from; the page that shows the robot adds them. */
  readonly meshOrigins = new Set<string>();
  readonly state: Signal<ConnectionState> = signal("connecting");
  /** Why there is no connection; empty while there is one. */
  readonly reason = signal("");
  readonly graph: Signal<Graph> = signal(EMPTY);

  /** True if the robot's names were requested, and the request has ended. */
  get hasAsked(): boolean {
    return this.graph.value !== EMPTY;
  }
  readonly permissions: Signal<Permissions> = signal(new Permissions(null));
  /** Topics that are not shown because of the bytes of a message. */
  readonly refused: Signal<ReadonlyMap<string, number>> = signal(new Map());
  /** Bytes of a message above which its topic is refused. */
  readonly messageBytes: number;
  readonly notices: Signal<Notice[]> = signal([]);
  /** Traffic of each subscribed topic in the last second. */
  readonly traffic: Signal<Map<string, Traffic & { seconds: number }>> = signal(new Map());
  /** Milliseconds for which the robot has not answered; 0 while it answers, and without a connection. */
  readonly silence = signal(0);
  /** Milliseconds that the last round trip took; 0 while that is not known. */
  readonly trip = signal(0);
  /** Milliseconds since 1970 at which the next attempt to connect begins; 0 if none is scheduled. */
  readonly retryAt = signal(0);
  /** Milliseconds since 1970 of the last answer before the robot fell silent or the connection was lost; 0 before. */
  readonly answeredAt = signal(0);
  /** Milliseconds since 1970 by this page's clock when the connection was made; 0 without one. */
  readonly connectedAt = signal(0);
  /** Number of connections made. */
  readonly connections = signal(0);
  /** The generation of ROS that the robot speaks. */
  readonly version: ReadonlySignal<1 | 2>;
  readonly distro = signal("");

  /** Everything that acts on the robot; {@link call} itself is for questions. */
  readonly commands: Commands;

  readonly rates = new Rates(this);

  private readonly saidVersion = signal(0);
  /** Milliseconds by which the robot's clock is ahead of this page's. */
  private clockOffset = 0;
  private readonly ros: Ros;
  private readonly decode: DecodeWorker;
  private readonly subscriptions: Subscriptions;
  private readonly definitions = new Map<string, Promise<Definitions>>();
  private readonly accepted = new Set<string>();
  private readonly abandoned = new Set<(error: RobotError) => void>();
  private readonly discoveryPeriod: number;
  private token: string;
  /** Attempts that have failed since a connection was made. */
  private attempts = 0;
  /** Of the attempt to connect that is the last one. */
  private number = 0;
  /** True if the next connection is made as soon as this one, or its attempt, is closed. */
  private beginsAnew = false;
  private noticeCount = 0;
  private retry: ReturnType<typeof setTimeout> | undefined;
  private discovery: ReturnType<typeof setTimeout> | undefined;
  private closed = false;

  constructor({
    url,
    token = "",
    worker,
    discovery = 3000,
    isRecording = false,
    messageBytes = Number.POSITIVE_INFINITY,
  }: SessionOptions) {
    this.url = url;
    this.messageBytes = messageBytes;
    this.isRecording = isRecording;
    this.token = token;
    this.discoveryPeriod = discovery;
    const base = new URL(url);
    base.protocol = base.protocol === "wss:" ? "https:" : "http:";
    base.search = base.hash = "";
    if (!base.pathname.endsWith("/")) base.pathname += "/";
    this.httpBase = base.href;
    this.version = computed(() => {
      if (this.saidVersion.value) return this.saidVersion.value === 1 ? 1 : 2;
      const types = [...this.graph.value.topics.values()];
      return types.length && !types.some((type) => type.includes("/msg/")) ? 1 : 2;
    });
    const decode = new DecodeWorker(worker, {
      onTraffic: (seconds, topics) => {
        this.traffic.value = new Map([...topics].map(([name, each]) => [name, { ...each, seconds }]));
      },
      onAnswering: ({ silence, clockOffset, trip }) => {
        if (silence > 0) this.answeredAt.value = Date.now() - silence;
        this.silence.value = silence;
        this.clockOffset = clockOffset;
        this.trip.value = trip;
      },
      onRefused: (topic, bytes) => {
        if (this.accepted.has(topic)) return;
        this.refused.value = new Map(this.refused.peek()).set(topic, bytes);
        this.subscriptions.pause(topic);
      },
      onStatus: (level, text, id) => this.noteStatus(level, text, id),
    });
    this.decode = decode;
    decode.bound(messageBytes, this.accepted);
    this.ros = new Ros({
      transportFactory: decode.factory(() => ({
        protocols: this.token ? ["rwt", `bearer.${this.token}`] : [],
        patience: at(CONNECT, this.attempts),
      })),
    });
    this.commands = new Commands(this, this.ros, (message) => decode.sendFresh(message));
    this.subscriptions = new Subscriptions(this.ros, (decodings) => decode.decode(decodings));
    this.ros.on("connection", () => this.opened());
    this.ros.on("close", (event) => this.lost(event as Closed));
    this.connect();
  }

  // -- the connection

  private connect(): void {
    this.number++;
    this.beginsAnew = false;
    this.retryAt.value = 0;
    this.ros.connect(this.url).catch((error: unknown) => this.lost({ code: 1006, reason: String(error) }));
  }

  private opened(): void {
    this.attempts = 0;
    this.definitions.clear();
    this.state.value = "open";
    this.reason.value = "";
    this.connectedAt.value = Date.now();
    this.connections.value++;
    this.ros.setStatusLevel("warning");
    void this.askVersion();
    if (this.isRecording) this.discover();
    else void this.askRole();
  }

  /** Ask what may be done, and then what there is: what opens by itself depends on both. */
  private async askRole(): Promise<void> {
    const connection = this.connections.peek();
    const isStale = () => this.connections.peek() !== connection || this.state.peek() !== "open";
    const answered = askPermissions(this.httpBase, this.token).then((permissions) => {
      if (!isStale()) this.permissions.value = permissions;
    });
    // A server whose HTTP keeps silent is waited for no longer than this; its answer counts whenever it comes.
    await Promise.race([answered, new Promise((later) => setTimeout(later, ROLE_FIRST))]);
    if (!isStale()) this.discover();
  }

  private lost({ code, reason }: Closed): void {
    const wasOpen = this.state.peek() === "open";
    if (wasOpen && this.silence.peek() === 0) this.answeredAt.value = Date.now();
    this.connectedAt.value = 0;
    this.silence.value = this.trip.value = 0;
    this.clockOffset = 0;
    clearTimeout(this.discovery);
    for (const abandon of [...this.abandoned]) abandon(new RobotError("the connection was lost"));
    if (this.closed) return;
    if (this.isRecording) {
      this.reason.value = reason;
      this.state.value = "lost";
      return;
    }
    if (this.beginsAnew) {
      this.connect();
      return;
    }
    // Typing a token is not interrupted by another rejected attempt.
    if (this.state.peek() !== "refused") this.state.value = "lost";
    const wait = at(BACKOFF, this.attempts++);
    const again = () => {
      this.retryAt.value = Date.now() + wait;
      this.retry = setTimeout(() => this.connect(), wait);
    };
    const said = reason || `${code}`;
    if (wasOpen) {
      this.reason.value = said;
      again();
    } else void this.askWhy(said, again);
  }

  /** A WebSocket that is refused does not say why; the same server's HTTP does. Without a token, no further attempt is made. */
  private async askWhy(said: string, again: () => void): Promise<void> {
    const { number } = this;
    let refusal = { status: 0, text: "" };
    try {
      const { status, text } = await ask(new URL("role", this.httpBase), this.httpHeaders);
      if (status === 401 || status === 403) refusal = { status, text };
    } catch {
      // There is no HTTP to be asked: what the WebSocket said is all there is.
    }
    if (this.closed || this.number !== number) return;
    this.reason.value = refusal.text || said;
    this.state.value = refusal.status ? "refused" : "lost";
    if (refusal.status !== 401) again();
  }

  /** Connect now instead of at the time of the next attempt. */
  retryNow(): void {
    if (this.retryAt.peek() === 0) return;
    clearTimeout(this.retry);
    this.connect();
  }

  /** Connect again, with another token. */
  authenticate(token: string): void {
    this.token = token;
    this.attempts = 0;
    this.retryAt.value = 0;
    clearTimeout(this.retry);
    this.state.value = "connecting";
    this.number++; // Whatever is still asked for the old token does not count.
    this.beginsAnew = this.decode.isBusy;
    if (this.beginsAnew) this.ros.close();
    else this.connect();
  }

  /** Headers that prove over HTTP who this client is. */
  get httpHeaders(): Record<string, string> {
    return this.token ? { Authorization: `Bearer ${this.token}` } : {};
  }

  /** True if connected, and the robot answers in time: only then may it be driven. */
  get isAnswering(): boolean {
    return this.state.value === "open" && this.silence.value === 0;
  }

  /** Milliseconds by which the robot's clock is ahead of this page's. */
  get clockAhead(): number {
    return this.clockOffset;
  }

  /** Milliseconds since 1970, or since the start of a simulation, by the robot's clock. */
  get robotTime(): number {
    return Date.now() + this.clockOffset;
  }

  /** End the connection for good. */
  close(): void {
    this.closed = true;
    clearTimeout(this.retry);
    clearTimeout(this.discovery);
    this.ros.close();
    this.decode.end();
  }

  // -- what there is

  private discover(): void {
    clearTimeout(this.discovery);
    void this.look().finally(() => {
      if (this.state.peek() === "open") {
        this.discovery = setTimeout(() => this.discover(), this.discoveryPeriod);
      }
    });
  }

  private async look(): Promise<void> {
    try {
      const [topics, services, actions, nodes] = await Promise.all([
        this.call<{ topics: string[]; types: string[] }>("/rosapi/topics", {}),
        this.call<{ services: string[] }>("/rosapi/services", {}),
        this.call<{ action_servers: string[] }>("/rosapi/action_servers", {}).catch(() => ({
          action_servers: [],
        })),
        this.call<{ nodes: string[] }>("/rosapi/nodes", {}).catch(() => ({ nodes: [] })),
      ]);
      const next: Graph = {
        topics: new Map(topics.topics.map((name, index) => [name, topics.types[index] ?? ""])),
        services: services.services,
        actions: actions.action_servers,
        nodes: nodes.nodes,
        problem: "",
      };
      if (!sameGraph(this.graph.peek(), next)) this.graph.value = next;
    } catch (error) {
      if (this.state.peek() === "open") {
        this.graph.value = { ...this.graph.peek(), problem: (error as Error).message };
      }
    }
  }

  private async askVersion(): Promise<void> {
    try {
      const said = await this.call<{ version: number; distro: string }>("/rosapi/get_ros_version", {});
      this.saidVersion.value = said.version;
      this.distro.value = said.distro;
    } catch {
      this.saidVersion.value = 0; // ROS 1's rosapi has no such service: the names of types tell.
    }
  }

  /** The topics of any of some types, sorted by name. Types are written without `/msg/`. */
  topicsOf(...types: string[]): string[] {
    const found: string[] = [];
    for (const [name, type] of this.graph.value.topics) if (types.includes(shortType(type))) found.push(name);
    return found.sort();
  }

  /** Return true if something is allowed, or at least not known to be refused. */
  may(act: Parameters<Permissions["may"]>[0], name: string): boolean {
    return this.permissions.value.may(act, name);
  }

  /** The definition of a message type, or of a half of a service or an action. */
  define(kind: "message" | "request" | "response" | "goal" | "result" | "feedback", type: string) {
    const key = `${kind} ${type}`;
    let known = this.definitions.get(key);
    if (!known) {
      const service = {
        message: "message_details",
        request: "service_request_details",
        response: "service_response_details",
        goal: "action_goal_details",
        result: "action_result_details",
        feedback: "action_feedback_details",
      }[kind];
      known = this.call<{ typedefs: RosapiTypeDef[] }>(`/rosapi/${service}`, { type }).then(
        ({ typedefs }) => new Definitions(typedefs),
      );
      known.catch(() => this.definitions.delete(key));
      this.definitions.set(key, known);
    }
    return known;
  }

  // -- asking

  /** Hear a topic until the returned function is called; see {@link Subscriptions.add}. */
  subscribe(name: string, type: string, listener: OnMessage, options?: SubscribeOptions): () => void {
    return this.subscriptions.add(name, type, listener, options);
  }

  /** Show a topic whatever the size of its messages. */
  accept(topic: string): void {
    this.accepted.add(topic);
    this.decode.bound(this.messageBytes, this.accepted);
    const refused = new Map(this.refused.peek());
    refused.delete(topic);
    this.refused.value = refused;
    this.subscriptions.resume(topic);
  }

  /**
   * Call a service that only answers; one that acts on the robot is called by {@link Commands.call}.
   *
   * @param patience milliseconds to wait for the answer
   * @throws RobotError the robot refuses, does not answer in time, or there is no connection
   */
  call<Answer = Message>(name: string, request: Message, type = "", patience = PATIENCE): Promise<Answer> {
    if (this.state.peek() !== "open") return Promise.reject(new RobotError("there is no connection"));
    return new Promise<Answer>((resolve, reject) => {
      const done = () => {
        clearTimeout(timer);
        this.abandoned.delete(abandon);
      };
      const abandon = (error: RobotError) => {
        done();
        reject(error);
      };
      const timer = setTimeout(
        () => abandon(new RobotError(`${name} does not answer for ${patience / 1000} s`)),
        patience,
      );
      this.abandoned.add(abandon);
      new Service<Message, Answer>({ ros: this.ros, name, serviceType: type }).callService(
        request,
        (answer) => {
          done();
          resolve(answer);
        },
        (problem) => abandon(new RobotError(String(problem))),
        patience / 1000,
      );
    });
  }

  /** Abandon a goal when the connection is lost. */
  abandonWithConnection(handle: GoalHandle): void {
    const abandon = () => handle.abandon("the connection was lost");
    this.abandoned.add(abandon);
    const forget = () => this.abandoned.delete(abandon);
    void handle.outcome.then(forget, forget);
  }

  // -- what is said

  /** Say something where everybody sees it. */
  note(level: Notice["level"], text: string, about = ""): void {
    const all = this.notices.peek();
    const kind = kindOf(text);
    const same = all.find(
      (each) => each.level === level && each.about === about && kindOf(each.text) === kind,
    );
    const number = ++this.noticeCount;
    const notice = { number, level, text, about, count: (same?.count ?? 0) + 1, at: Date.now() };
    this.notices.value = [...all.filter((each) => each !== same).slice(1 - MOST_NOTICES), notice];
  }

  private noteStatus(level: string, text: string, id: string | undefined): void {
    // roslib's ids are OPERATION:NAME:UUID.
    const about = /^[a-z_]+:([^:]+):/.exec(id ?? "")?.[1] ?? "";
    this.note(level === "error" ? "error" : level === "warning" ? "warning" : "info", text, about);
  }
}

/** A text without its numbers: repeated notices differ in them. */
function kindOf(text: string): string {
  return text.replace(/\d+(\.\d+)?/g, "#");
}

/** The one of a row that belongs to an attempt; the last one for all that follow. */
function at(row: readonly number[], attempt: number): number {
  return row[Math.min(attempt, row.length - 1)] as number;
}

async function ask(url: URL, headers: Record<string, string>): Promise<{ status: number; text: string }> {
  const response = await fetch(url, { headers, signal: AbortSignal.timeout(WHY) });
  return { status: response.status, text: (await response.text()).trim() };
}

function sameGraph(one: Graph, other: Graph): boolean {
  if (one.problem !== other.problem || one.topics.size !== other.topics.size) return false;
  for (const [name, type] of one.topics) if (other.topics.get(name) !== type) return false;
  return (["services", "actions", "nodes"] as const).every(
    (key) => one[key].length === other[key].length && one[key].every((name, at) => name === other[key][at]),
  );
}
