/** The robot's name, as its description (URDF) has it. */

import { effect, type ReadonlySignal, signal } from "@preact/signals-core";
import type { RobotSession } from "./session";

const NAME = "/robot_description";

/** Name of a robot by its URDF; empty until that is known, and without one. */
export function describedName(session: RobotSession): ReadonlySignal<string> {
  const name = signal("");
  const take = (urdf: unknown) => {
    name.value = /<robot\b[^>]*\sname="([^"<]{1,64})"/.exec(String(urdf))?.[1] ?? "";
  };
  effect(() => {
    const { topics, services } = session.graph.value;
    if (name.peek() || session.state.value !== "open") return undefined;
    const type = topics.get(NAME);
    // Of ROS 1 it is a parameter.
    if (!type && session.version.value === 1 && services.includes("/rosapi/get_param")) {
      if (session.may("get_param", NAME)) {
        session
          .call<{ value: string }>("/rosapi/get_param", { name: NAME, default: '""' })
          .then(({ value }) => take(JSON.parse(value)))
          .catch(() => undefined); // There is none.
      }
      return undefined;
    }
    if (!type || !session.may("subscribe", NAME)) return undefined;
    const end = session.subscribe(NAME, type, ({ data }) => {
      take(data);
      queueMicrotask(() => end());
    });
    return end;
  });
  return name;
}
