/** Cameras and microphones that the robot receives now, reported to permitted clients. */

import { effect, type Signal, signal } from "@preact/signals-core";
import { seconds } from "./names";
import type { RobotSession } from "./session";

const TOPIC = "/whip/senders";

/** One camera or microphone that is on. */
export interface Sender {
  /** On which it is published. */
  topic: string;
  kind: string;
  client: string;
  role: string;
  /** Seconds of the robot's time. */
  since: number;
}

/** Those that are on, for as long as the robot has the topic. */
export function mediaSenders(session: RobotSession): Signal<readonly Sender[]> {
  const senders = signal<readonly Sender[]>([]);
  effect(() => {
    if (!session.graph.value.topics.has(TOPIC) || !session.may("subscribe", TOPIC)) {
      senders.value = [];
      return undefined;
    }
    return session.subscribe(TOPIC, "rwt_gate_msgs/MediaSenders", (message) => {
      const told = (message as { senders: (Omit<Sender, "since"> & { since: unknown })[] }).senders;
      senders.value = told.map((each) => ({ ...each, since: seconds(each.since) }));
    });
  });
  return senders;
}
