/** Facts in the head and the foot of the page. */

import { useSignal } from "@preact/signals";
import { Activity, BatteryMedium, Clock, ArrowDown as Down, LifeBuoy as Wheel } from "lucide";
import { Icon } from "../forms/icon";
import { clockText, fixed } from "../i18n/formats";
import { t } from "../i18n/text";
import { now, useMessages } from "../panels/component";
import { sizeText } from "../panels/health/recorder";
import { driveTopics } from "../robot/drive";
import { personText } from "../robot/gate";
import { seconds } from "../robot/names";
import type { RobotSession } from "../robot/session";
import type { Message } from "../robot/subscriptions";
import type { App } from "./state";

/** The last message of a topic; null before it, and where there is none. */
function useLast(session: RobotSession, topic: string): Message | null {
  const last = useSignal<{ of: string; message: Message } | null>(null);
  const take = (message: Message, of: string) => {
    last.value = { of, message };
  };
  const isHeard = useMessages(session, topic, take, { throttle: 1000 });
  return isHeard && last.value?.of === topic ? last.value.message : null;
}

/** Charge of the battery. */
export function BatteryFact({ app }: { app: App }) {
  const { session } = app;
  const state = useLast(session, session.topicsOf("sensor_msgs/BatteryState")[0] ?? "");
  const share = Number(state?.percentage ?? Number.NaN);
  if (!Number.isFinite(share)) return null;
  const voltage = Number(state?.voltage ?? Number.NaN);
  return (
    <div class={share < 0.2 ? "fact low" : "fact"} title={t("battery.title")}>
      <Icon of={BatteryMedium} />
      <div>
        <b>{fixed(share * 100, 0)} %</b>
        {Number.isFinite(voltage) && <small>{fixed(voltage, 1)} V</small>}
      </div>
    </div>
  );
}

/** Name of the driver, if the robot reports it; opens the Drive panel. */
export function DriverFact({ app }: { app: App }) {
  const { gate, stopped } = app.stop;
  const topic = driveTopics(app.session).find((each) => gate.holders.value.has(each));
  const holder = topic ? gate.holders.value.get(topic) : undefined;
  if (!holder) return null;
  const isMine = holder.name !== "" && holder.name === gate.client.value;
  const asks = isMine ? holder.requests.length : 0;
  const text = stopped.value
    ? t("lease.stopped")
    : isMine
      ? t("teleop.mine")
      : holder.name
        ? t("teleop.held", { name: personText(holder) })
        : t("teleop.free");
  return (
    <button
      type="button"
      class={`lease-fact${isMine && !stopped.value ? " mine" : ""}`}
      title={holder.name}
      onClick={() => app.open("teleop")}
    >
      <Icon of={Wheel} />
      {text}
      {asks > 0 && <em class="badge">{asks}</em>}
    </button>
  );
}

/** The recording that is made. */
export function RecordingFact({ app }: { app: App }) {
  const state = useLast(app.session, "/recorder/state");
  if (!state?.recording) return null;
  const span = Math.max(0, Math.round(now.value / 1000 - seconds(state.since)));
  const text = `${Math.floor(span / 60)}:${String(span % 60).padStart(2, "0")}`;
  return (
    <button type="button" class="rec" onClick={() => app.open("player")}>
      <span class="dot" aria-hidden="true" />
      <span class="hidden">{t("recorder.title")}</span>
      <b>REC {text}</b>
      <small>{sizeText(Number(state.bytes))}</small>
    </button>
  );
}

/** The robot's time. */
export function ClockFact({ session }: { session: RobotSession }) {
  now.value;
  if (session.trip.value === 0) return null;
  return (
    <div class="fact clock">
      <div>
        <b>{clockText(session.robotTime)}</b>
        <small>{t("fact.robot_time")}</small>
      </div>
    </div>
  );
}

/** The role of this page. */
export function RoleFact({ session }: { session: RobotSession }) {
  const { role } = session.permissions.value;
  if (!role || session.state.value !== "open") return null;
  return (
    <div class="fact role" title={t("role.may", { role })}>
      <span class="avatar" aria-hidden="true">
        {role.slice(0, 2).toUpperCase()}
      </span>
      <div>
        <b>{role}</b>
        <small>{t("server.role")}</small>
      </div>
    </div>
  );
}

/** For experts: traffic, clock, versions. */
export function Footer({ session }: { session: RobotSession }) {
  let bytes = 0;
  let messages = 0;
  for (const each of session.traffic.value.values()) {
    bytes += each.bytes / each.seconds;
    messages += each.messages / each.seconds;
  }
  now.value;
  const ahead = session.clockAhead / 1000;
  const isKnown = session.trip.value > 0;
  return (
    <div class="facts">
      <span title={t("fact.received")}>
        <Icon of={Down} size={14} /> {sizeText(Math.round(bytes))}/s
      </span>
      <span title={t("fact.messages")}>
        <Icon of={Activity} size={14} /> {fixed(messages, 0)} {t("fact.per_second")}
      </span>
      {isKnown && (
        <span title={t("fact.ahead")}>
          <Icon of={Clock} size={14} /> {ahead < 0 ? "−" : "+"}
          {Math.abs(ahead) < 10 ? `${fixed(Math.abs(ahead) * 1000, 0)} ms` : `${fixed(Math.abs(ahead), 0)} s`}
        </span>
      )}
    </div>
  );
}
