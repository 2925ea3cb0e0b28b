/** The one path of everything that this page sends to a robot. */

import { computed, effect, type ReadonlySignal, type Signal, signal } from "@preact/signals-core";
import { type Ros, Topic } from "roslib";
import { type GoalHandle, type GoalOptions, sendGoal } from "./goals";
import type { Act } from "./permissions";
import type { RobotSession } from "./session";
import type { Message } from "./subscriptions";

/** Why no command is sent: the stop is on, the robot does not answer in time, or there is no connection or no robot. */
export type Block = "stopped" | "silent" | "lost" | "recording";
/** Also a role to which the robot refuses this one command. */
export type Refused = Block | "role";

/** Blocked command, for people. */
export interface BlockedCommand {
  number: number;
  why: Refused;
  /** Topic, service or action. */
  name: string;
}

/** A command that was not sent because commands are blocked. */
export class BlockedError extends Error {
  constructor(
    readonly why: Refused,
    readonly target: string,
  ) {
    super(`${target}: not sent (${BLOCKS[why]})`);
  }
}

const BLOCKS: Record<Refused, string> = {
  stopped: "the stop is on",
  silent: "the robot does not answer",
  lost: "there is no connection",
  recording: "a recording is shown, not a robot",
  role: "the role does not allow it",
};

const SET_PARAM = "/rosapi/set_param";
/** Milliseconds for which the robot may still move by a message: more than any controller waits for the next one. */
const MOVES_ON = 5000;

/** A topic that this page publishes on. */
export interface RobotPublisher {
  /** Publish; returns false if commands are blocked. */
  publish(message: Message): boolean;
  /** Publish a sample, which is also dropped if much waits to be sent; returns false if commands are blocked. */
  publishFresh(message: Message): boolean;
  /** Publish a command that makes the robot stand still: it is never blocked, only lost without a connection. */
  publishZero(message: Message): void;
  dispose(): void;
}

/**
 * Publications, calls and goals of one session.
 *
 * While commands are blocked, only those pass that stop the robot or reduce what this page may do: `publishZero`,
 * `callSafe`, and the cancellation of goals.
 */
export class Commands {
  /** Written by the page's stop. */
  readonly stopped: Signal<boolean> = signal(false);
  /** Why commands are blocked; null while they are sent. */
  readonly block: ReadonlySignal<Block | null>;
  /** The last command that was blocked; null before the first. */
  readonly lastBlocked: Signal<BlockedCommand | null> = signal(null);

  private readonly publishers = new Map<string, { topic: Topic<Message>; users: number }>();
  private blockedCount = 0;
  private samples = 0;
  private publishedAt = Number.NEGATIVE_INFINITY;
  /** Goals that have not ended. */
  private goals = 0;

  constructor(
    private readonly session: RobotSession,
    private readonly ros: Ros,
    private readonly sendFresh: (message: object) => void,
  ) {
    this.block = computed(() => {
      if (session.isRecording) return "recording";
      if (session.state.value !== "open") return "lost";
      if (this.stopped.value) return "stopped";
      return session.silence.value > 0 ? "silent" : null;
    });
    effect(() => {
      if (!this.block.value) this.lastBlocked.value = null;
    });
  }

  /** A publisher, advertised while anybody holds it. */
  publisher(name: string, type: string): RobotPublisher {
    const key = `${name} ${type}`;
    let known = this.publishers.get(key);
    if (!known) {
      known = { topic: new Topic<Message>({ ros: this.ros, name, messageType: type }), users: 0 };
      if (this.session.permissions.peek().may("publish", name)) known.topic.advertise();
      this.publishers.set(key, known);
    }
    const mine = known;
    mine.users++;
    let held = true;
    return {
      publish: (message) => {
        if (!held || !this.mayCommand(name, "publish")) return false;
        this.publishedAt = performance.now();
        mine.topic.publish(message);
        return true;
      },
      publishFresh: (msg) => {
        if (!held || !this.mayCommand(name, "publish")) return false;
        this.publishedAt = performance.now();
        this.sendFresh({ op: "publish", id: `publish:${name}:${++this.samples}`, topic: name, msg });
        return true;
      },
      publishZero: (message) => {
        // Without a connection a message is dropped: roslib would keep it and send it much later.
        if (held && this.session.state.peek() === "open") mine.topic.publish(message);
      },
      dispose: () => {
        if (!held) return;
        held = false;
        if (--mine.users === 0) {
          mine.topic.unadvertise();
          this.publishers.delete(key);
        }
      },
    };
  }

  /**
   * Call a service that acts on the robot.
   *
   * @param patience milliseconds to wait for the answer
   * @throws BlockedError commands are blocked
   * @throws RobotError the robot refuses, or does not answer in time
   */
  async call<Answer = Message>(
    name: string,
    request: Message,
    type = "",
    patience?: number,
  ): Promise<Answer> {
    if (name === SET_PARAM) this.require(String(request.name), "set_param");
    else this.require(name, "call");
    return this.session.call<Answer>(name, request, type, patience);
  }

  /**
   * Call a service that stops something, or reduces what this page may do.
   *
   * @throws RobotError the robot refuses, does not answer in time, or there is no connection
   */
  callSafe<Answer = Message>(name: string, request: Message, type = ""): Promise<Answer> {
    return this.session.call<Answer>(name, request, type);
  }

  /**
   * Send a goal to an action server, in the way of the robot's generation of ROS.
   *
   * @throws BlockedError commands are blocked
   */
  sendGoal(action: string, type: string, goal: Message, options: GoalOptions = {}): GoalHandle {
    this.require(action, "goals");
    const handle = sendGoal(this.ros, this.session.version.peek(), action, type, goal, options);
    this.session.abandonWithConnection(handle);
    this.goals++;
    const end = () => this.goals--;
    void handle.outcome.then(end, end);
    return handle;
  }

  /** True if the robot may move by what this page has sent: a message of the last seconds, or a goal that has not ended. */
  get isActing(): boolean {
    return this.goals > 0 || performance.now() - this.publishedAt < MOVES_ON;
  }

  private require(name: string, act: Act): void {
    const why = this.refusal(name, act);
    if (!why) return;
    this.mayCommand(name, act);
    throw new BlockedError(why, name);
  }

  private refusal(name: string, act: Act): Refused | null {
    const why = this.block.peek();
    // Of its own services the gate decides for itself.
    if (why || (act === "call" && name.startsWith("/gate/"))) return why;
    return this.session.permissions.peek().may(act, name.replace(/^(?!\/)/, "/")) ? null : "role";
  }

  /** True if a command is sent; otherwise the attempt is noted, once in a row for each name. */
  mayCommand(name: string, act: Act): boolean {
    const why = this.refusal(name, act);
    if (!why) return true;
    const last = this.lastBlocked.peek();
    if (last?.name !== name || last.why !== why) {
      this.lastBlocked.value = { number: ++this.blockedCount, why, name };
    }
    return false;
  }
}
