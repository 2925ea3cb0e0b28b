/** The robot's gate, where its server has one: who drives by which topic, and the stop that holds for everybody. */

import { computed, effect, type ReadonlySignal, type Signal, signal } from "@preact/signals-core";
import type { RobotSession } from "./session";
import type { Message } from "./subscriptions";

const STOP = "/gate/stop";

/** A client at the gate, as people recognise it. */
export interface Person {
  /** Name of its connection; empty without a holder. */
  name: string;
  role: string;
  /** Name of its token; empty without one. */
  user: string;
  /** Its program and system, or its address. */
  device: string;
}

/** Holder of a topic's lease, and clients that request it. */
export interface Holder extends Person {
  requests: readonly Person[];
}

const textOf = (value: unknown) => (typeof value === "string" ? value : "");

const recordsOf = (value: unknown) => (Array.isArray(value) ? (value as Message[]) : []);

/** Person of a part of `rwt_gate_msgs/Leases`, of which a server may leave out fields. */
function personOf(name: unknown, { role, user, device }: Message): Person {
  return { name: textOf(name), role: textOf(role), user: textOf(user), device: textOf(device) };
}

/** Displayed name of a client: its token, else its role, and its device. */
export function personText({ role, user, device }: Person): string {
  return `${user || role}${device && ` (${device})`}`;
}

/** An act of a client that waits for a person's yes. */
export interface Approval {
  id: string;
  /** `publish`, `call`, `goal` or `set_param`. */
  act: string;
  name: string;
  rule: string;
  client: string;
  role: string;
  /** The message, request or goal as JSON, cut where it is long. */
  content: string;
  asked: unknown;
  /** For the answer, from `asked` on. */
  seconds: number;
  /** Seconds that an approval may last; 0: for this command alone. */
  remember_seconds: number;
}

interface StopState {
  stopped: boolean;
  by: string;
  reason: string;
}

interface GateAnswer {
  success: boolean;
  message: string;
}

const MOVING: StopState = { stopped: false, by: "", reason: "" };

export class Gate {
  /** True if the robot has a gate. */
  readonly present: ReadonlySignal<boolean>;
  /** The stop of the robot, which no page can pass by. */
  readonly stop: Signal<StopState> = signal(MOVING);
  /** Leases of the topics on which one client at a time publishes. */
  readonly holders: Signal<ReadonlyMap<string, Holder>> = signal(new Map());
  /** Name of this page's client at the gate; empty until the gate has said it. */
  readonly client = signal("");
  /** Pending approvals. */
  readonly approvals: Signal<readonly Approval[]> = signal([]);

  constructor(private readonly session: RobotSession) {
    this.present = computed(() => session.graph.value.services.includes(STOP));
    effect(() => {
      // The name is that of one connection.
      session.connections.value;
      this.client.value = "";
      if (!this.present.value) {
        this.stop.value = MOVING;
        this.holders.value = new Map();
        this.approvals.value = [];
        return undefined;
      }
      const ends = [
        session.subscribe("/gate/stopped", "rwt_gate_msgs/EmergencyStop", (message) => {
          this.stop.value = message as unknown as StopState;
        }),
        session.subscribe("/gate/leases", "rwt_gate_msgs/Leases", (message) => {
          const leases = recordsOf(message.leases);
          this.holders.value = new Map(
            leases.map((lease) => {
              const requests = recordsOf(lease.requests).map((each) => personOf(each.client, each));
              return [textOf(lease.topic), { ...personOf(lease.holder, lease), requests }];
            }),
          );
          if (leases.length && !this.client.peek()) void this.introduce();
        }),
        ...(session.may("subscribe", "/gate/approvals")
          ? [
              session.subscribe("/gate/approvals", "rwt_gate_msgs/Approvals", (message) => {
                this.approvals.value = recordsOf(message.approvals) as unknown as Approval[];
              }),
            ]
          : []),
      ];
      return () => {
        for (const end of ends) end();
      };
    });
  }

  /**
   * Stop the robot for everybody.
   *
   * @throws RobotError it does not answer, or refuses
   */
  async press(): Promise<void> {
    await this.ask(STOP, "rwt_gate_msgs/Stop", { reason: "by the page" });
  }

  /**
   * Let the robot be moved again.
   *
   * @throws RobotError it does not answer, or the role may not
   */
  async release(): Promise<void> {
    await this.ask("/gate/release_stop", "rwt_gate_msgs/Stop", { reason: "by the page" });
  }

  /**
   * Answer what waits for a yes.
   *
   * @param seconds how long a yes holds for the same client, name and rule; 0: for this act alone
   * @throws RobotError it does not answer, or the role may not
   */
  async answer(id: string, approve: boolean, seconds = 0): Promise<void> {
    const request = { id, approve, seconds };
    await this.ask("/gate/approve", "rwt_gate_msgs/Approve", request, !approve);
  }

  /**
   * Take the lease of a topic; a role with precedence takes it from another holder.
   *
   * @throws Error another client holds it, or commands are blocked
   */
  async take(topic: string): Promise<void> {
    await this.ask("/gate/take_lease", "rwt_gate_msgs/Lease", { topic }, false);
  }

  /**
   * Ask the holder of a topic's lease to hand it over; the holder sees it for half a minute.
   *
   * @throws Error there is no other holder, or commands are blocked
   */
  async request(topic: string): Promise<void> {
    await this.ask("/gate/request_lease", "rwt_gate_msgs/Lease", { topic }, false);
  }

  /**
   * Hand the lease of a topic over to a client that asks for it; the robot stops until that one drives.
   *
   * @throws Error this page does not hold it, or the client is gone
   */
  async handOver(topic: string, to: Person): Promise<void> {
    await this.ask("/gate/pass_lease", "rwt_gate_msgs/PassLease", { topic, to: to.name });
  }

  /** Ask for the name of this page's client, which every answer about a lease has, also where there is none. */
  private async introduce(): Promise<void> {
    const none = { topic: "/" };
    const answer = await this.session.commands
      .callSafe<{ client: string }>("/gate/release_lease", none, "rwt_gate_msgs/Lease")
      .catch(() => null); // Asked again with the next message.
    if (answer) this.client.value = answer.client;
  }

  /** Release the lease of a topic; the server checks that this page holds it. */
  giveBack(topic: string): void {
    const { session } = this;
    if (!this.present.peek() || !this.holders.peek().get(topic)?.name) return;
    if (session.state.peek() !== "open") return;
    // Another client's is not given back by this, which is no problem to tell.
    session.commands.callSafe("/gate/release_lease", { topic }, "rwt_gate_msgs/Lease").catch(() => undefined);
  }

  /** Call a service of the gate; `isSafe` if it lets nothing move. */
  private async ask(
    service: string,
    type: string,
    request: Record<string, unknown>,
    isSafe = true,
  ): Promise<void> {
    const { commands } = this.session;
    const answer = isSafe
      ? await commands.callSafe<GateAnswer>(service, request, type)
      : await commands.call<GateAnswer>(service, request, type);
    if (!answer.success) throw new Error(answer.message);
  }
}
