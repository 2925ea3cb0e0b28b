/** What the robot's gate says: who drives, and why nothing moves. */

import { useTexts } from "../i18n/context";
import type { Texts } from "../i18n/text";
import type { Gate } from "../robot/gate";
import type { Stop } from "../robot/stop";

/** Why nothing moves, while it is stopped. */
export function stopText(stop: Stop, t: Texts): string {
  const { stopped, by } = stop.gate.stop.value;
  return stopped ? t("stop.gate", { by }) : t("stop.stopped");
}

/** A light with who drives by a topic; nothing where anybody may at any time. */
export function Driver({ gate, topic }: { gate: Gate; topic: string }) {
  const t = useTexts();
  const holder = gate.holders.value.get(topic);
  if (!holder) return null;
  return (
    <p class={holder.name ? "driver held" : "driver"} part="driver" role="status">
      <span class="dot" aria-hidden="true" />
      {holder.name ? t("teleop.held", { name: holder.name, role: holder.role }) : t("teleop.free")}
    </p>
  );
}
