/** The robot's description (URDF), and its name in it. */

import { effect, type ReadonlySignal, signal } from "@preact/signals-core";
import type { RobotSession } from "./session";

const NAME = "/robot_description";

/**
 * Call `take` with the robot's URDF when it is known, once.
 *
 * @returns what ends it
 */
export function hearDescription(session: RobotSession, take: (urdf: string) => void): () => void {
  let isKnown = false;
  const found = (urdf: unknown) => {
    if (isKnown) return;
    isKnown = true;
    take(String(urdf));
  };
  return effect(() => {
    const { topics, services } = session.graph.value;
    if (isKnown || session.state.value !== "open") return undefined;
    const type = topics.get(NAME);
    // Of ROS 1 it is a parameter.
    if (!type && session.version.value === 1 && services.includes("/rosapi/get_param")) {
      if (session.may("get_param", NAME)) {
        session
          .call<{ value: string }>("/rosapi/get_param", { name: NAME, default: '""' })
          .then(({ value }) => found(JSON.parse(value)))
          .catch(() => undefined); // There is none.
      }
      return undefined;
    }
    if (!type || !session.may("subscribe", NAME)) return undefined;
    const end = session.subscribe(NAME, type, ({ data }) => {
      found(data);
      queueMicrotask(() => end());
    });
    return end;
  });
}

/** Name of a robot by its URDF; empty until that is known, and without one. */
export function describedName(session: RobotSession): ReadonlySignal<string> {
  const name = signal("");
  hearDescription(session, (urdf) => {
    name.value = /<robot\b[^>]*\sname="([^"<]{1,64})"/.exec(urdf)?.[1] ?? "";
  });
  return name;
}
