/** One topic of an element: which it is, and why there is nothing to see of it. */

import { useEffect } from "preact/hooks";
import { Problem } from "../../forms/problem";
import type { Texts } from "../../i18n/text";
import type { RobotSession } from "../../robot/session";
import type { Message, SubscribeOptions } from "../../robot/subscriptions";

export interface ChosenTopic {
  name: string;
  type: string;
}

/**
 * The topic that an element names, or else the first of its types; in its place what is to be said where there is
 * none, it is of another type, or this client may not hear it.
 */
export function chooseTopic(
  session: RobotSession,
  named: string,
  types: readonly string[],
  t: Texts,
): ChosenTopic | { problem: string } {
  const fitting = session.topicsOf(...types);
  const all = session.graph.value.topics;
  const name = named || fitting[0];
  if (name === undefined) {
    const { problem } = session.graph.value;
    if (problem) return { problem: t("discovery.problem", { reason: problem }) };
    return { problem: all.size ? t("widget.topic.none", { types: types.join(", ") }) : "" };
  }
  if (!session.may("subscribe", name)) {
    const { role } = session.permissions.value;
    return { problem: t("role.refused", { role, act: t("act.subscribe"), name }) };
  }
  const type = all.get(name);
  if (type === undefined) {
    const { problem } = session.graph.value;
    if (!problem) return { problem: all.size ? t("widget.topic.gone", { name }) : "" };
    // A robot that does not say what it offers may have the topic none the less.
    const [likely] = types;
    return likely ? { name, type: likely } : { problem: t("discovery.problem", { reason: problem }) };
  }
  if (types.length > 0 && !fitting.includes(name)) {
    return { problem: t("widget.topic.type", { name, type, types: types.join(", ") }) };
  }
  return { name, type };
}

/** Text shown instead of a topic; empty until the robot has listed its topics. */
export function NoTopic({ problem }: { problem: string }) {
  return problem ? <Problem text={problem} /> : null;
}

/** Hear a topic for as long as a view is shown. */
export function useTopic(
  session: RobotSession,
  topic: ChosenTopic,
  listener: (message: Message) => void,
  options: SubscribeOptions = {},
): void {
  const { name, type } = topic;
  const { throttle = 0, decoding } = options;
  useEffect(
    () => session.subscribe(name, type, listener, decoding ? { throttle, decoding } : { throttle }),
    [session, name, type, throttle, decoding],
  );
}
