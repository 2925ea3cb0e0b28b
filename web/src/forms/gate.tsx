/** Reports of the robot's gate: the driver, and reasons for blocked commands. */

import { useSignal } from "@preact/signals";
import { useTexts } from "../i18n/context";
import type { Texts } from "../i18n/text";
import { type Gate, personText } from "../robot/gate";
import type { RobotSession } from "../robot/session";
import type { Stop } from "../robot/stop";
import { Commanding } from "./commanding";
import { Problem } from "./problem";

/** Why nothing moves, while it is stopped. */
export function stopText(stop: Stop, t: Texts): string {
  const { stopped, by } = stop.gate.stop.value;
  return stopped ? t("stop.gate", { by }) : t("stop.stopped");
}

/** A light with who drives by a topic, and its lease; nothing where anybody may at any time. */
export function Driver({ gate, topic, session }: { gate: Gate; topic: string; session: RobotSession }) {
  const t = useTexts();
  const problem = useSignal("");
  const holder = gate.holders.value.get(topic);
  if (!holder) return null;
  const { name, requests } = holder;
  const isMine = name !== "" && name === gate.client.value;
  const asks = requests.some((each) => each.name === gate.client.value);
  const attempt = async (act: Promise<void>) => {
    problem.value = "";
    try {
      await act;
    } catch (error) {
      problem.value = (error as Error).message;
    }
  };
  return (
    <div class="lease" part="lease">
      <p class={name ? "driver held" : "driver"} part="driver" role="status">
        <span class="dot" aria-hidden="true" />
        {isMine ? t("teleop.mine") : name ? t("teleop.held", { name: personText(holder) }) : t("teleop.free")}
      </p>
      {isMine ? (
        <button type="button" part="button" onClick={() => gate.giveBack(topic)}>
          {t("teleop.give")}
        </button>
      ) : (
        <Commanding session={session} quiet>
          <button type="button" part="button" onClick={() => attempt(gate.take(topic))}>
            {t(name ? "teleop.take.over" : "teleop.take")}
          </button>
          {name && (
            <button type="button" part="button" disabled={asks} onClick={() => attempt(gate.request(topic))}>
              {t(asks ? "teleop.asked" : "teleop.ask")}
            </button>
          )}
        </Commanding>
      )}
      {isMine &&
        requests.map((each) => (
          <p key={each.name} class="lease-request" part="request" role="status">
            {t("teleop.asks", { name: personText(each) })}{" "}
            <button type="button" part="button" onClick={() => attempt(gate.handOver(topic, each))}>
              {t("teleop.hand_over")}
            </button>
          </p>
        ))}
      {problem.value && <Problem text={problem.value} />}
    </div>
  );
}

/** Report of numbers that the gate clamped. */
const CLAMPED = /([\w.[\]]+): (\S+) in place of ([^;\s]+)/g;
/** Milliseconds for which that is shown. */
const SHOWN_FOR = 3000;

/** Values of a topic that the gate has reduced just now. */
export function Clamped({ session, topic, now }: { session: RobotSession; topic: string; now: number }) {
  const t = useTexts();
  // The gate's own messages have no id that names the topic.
  const begin = `gate: publish ${topic}: `;
  const notice = session.notices.value.findLast(
    ({ text }) => text.startsWith(begin) && text.includes(" in place of "),
  );
  if (!notice || now - notice.at > SHOWN_FOR) return null;
  return (
    <ul class="clamped" part="clamped">
      {[...notice.text.matchAll(CLAMPED)].map(([, field, value, wanted]) => (
        <li key={field}>
          {t("teleop.clamped", { field: field ?? "", value: value ?? "", wanted: wanted ?? "" })}
        </li>
      ))}
    </ul>
  );
}
