/** Health of the robot: diagnostics and battery. */

import { useSignal } from "@preact/signals";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import type { Message } from "../../robot/subscriptions";
import { componentPanel, Needs, now, useMessages } from "../component";
import { hasTopics, type PanelContext, type PanelKind } from "../registry";

const LEVELS = ["ok", "warn", "error", "stale"] as const;
/** The levels by their urgency, the least first: what is known to be broken comes before what is not known. */
const URGENCY = ["ok", "warn", "stale", "error"] as const;
/** Seconds after which what is no longer told is stale. */
const STALE = 10;
const MOST = 2000;

interface Status {
  level: number;
  name: string;
  message: string;
  hardware: string;
  values: { key: string; value: string }[];
  at: number;
}

export const diagnostics: PanelKind = {
  name: "diagnostics",
  title: "diagnostics.title",
  supportedTypes: ["diagnostic_msgs/DiagnosticArray"],
  opens: (session) => hasTopics(diagnostics, session),
  place: "below",
  init: componentPanel(DiagnosticsPanel),
};

export const battery: PanelKind = {
  name: "battery",
  title: "battery.title",
  supportedTypes: ["sensor_msgs/BatteryState"],
  opens: (session) => hasTopics(battery, session),
  place: "below",
  init: componentPanel(BatteryPanel),
};

/** Hear the topics of a panel's types while it is seen. */
function useTopics(
  { session, visible }: PanelContext,
  kind: PanelKind,
  take: Parameters<typeof useMessages>[2],
) {
  return useMessages(session, session.topicsOf(...kind.supportedTypes), take, {
    throttle: 200,
    isOn: visible.value,
  });
}

function DiagnosticsPanel({ context }: { context: PanelContext }) {
  const { session } = context;
  const known = useSignal(new Map<string, Status>());
  const isThere = useTopics(context, diagnostics, (message) => {
    const next = new Map(known.value);
    for (const each of (message.status as Record<string, unknown>[] | undefined) ?? []) {
      const name = String(each.name);
      if (!next.has(name) && next.size >= MOST) continue;
      next.set(name, {
        level: Math.max(0, Math.min(3, Number(each.level) || 0)),
        name,
        message: String(each.message),
        hardware: String(each.hardware_id),
        values: (each.values as Status["values"]) ?? [],
        at: Date.now(),
      });
    }
    known.value = next;
  });
  const levelOf = ({ at, level }: Status) =>
    (now.value - at) / 1000 > STALE ? "stale" : (LEVELS[level] ?? "ok");
  const urgency = (status: Status) => URGENCY.indexOf(levelOf(status));
  const all = [...known.value.values()].sort(
    (one, other) => urgency(other) - urgency(one) || (one.name < other.name ? -1 : 1),
  );
  if (!all.length && !isThere) return <Needs kind={diagnostics} />;
  if (!all.length)
    return (
      <p class="faint">
        {t("panel.waiting", { name: session.topicsOf(...diagnostics.supportedTypes).join(", ") })}
      </p>
    );
  const worst = levelOf(all[0] as Status);
  return (
    <div class="diagnostics">
      <p class={`level level-${worst}`} role="status">
        {t(`diagnostics.${worst}`)} · {t("diagnostics.count", { count: all.length })}
      </p>
      {all.map((status) => {
        const level = levelOf(status);
        return (
          <details key={status.name}>
            <summary>
              <span class={`level level-${level}`}>{t(`diagnostics.${level}`)}</span> {status.name}{" "}
              <span class="faint">{status.message}</span>
            </summary>
            <table>
              <tbody>
                {status.values.map(({ key, value }) => (
                  <tr key={key}>
                    <th scope="row">{key}</th>
                    <td>{value}</td>
                  </tr>
                ))}
              </tbody>
            </table>
          </details>
        );
      })}
    </div>
  );
}

const CHARGING = ["unknown", "charging", "discharging", "still", "full"] as const;

function BatteryPanel({ context }: { context: PanelContext }) {
  const { session } = context;
  const known = useSignal(new Map<string, Message>());
  const isThere = useTopics(context, battery, (message, topic) => {
    known.value = new Map(known.value).set(topic, message);
  });
  if (!known.value.size && !isThere) return <Needs kind={battery} />;
  if (!known.value.size)
    return (
      <p class="faint">
        {t("panel.waiting", { name: session.topicsOf(...battery.supportedTypes).join(", ") })}
      </p>
    );
  return (
    <div class="battery">
      {[...known.value].map(([topic, state]) => {
        const share = Number(state.percentage ?? Number.NaN);
        const status = CHARGING[Number(state.power_supply_status)] ?? "unknown";
        const number = (value: unknown, unit: string) =>
          Number.isFinite(value) ? `${fixed(Number(value), 2)} ${unit}` : "–";
        return (
          <section key={topic}>
            <h2>{topic}</h2>
            {Number.isFinite(share) && (
              <>
                <meter min={0} max={1} low={0.2} high={0.5} optimum={1} value={share} aria-label={topic} />{" "}
                <b class="number">{fixed(share * 100, 0)} %</b>
              </>
            )}
            <p>
              {number(state.voltage, "V")} · {number(state.current, "A")} · {t(`battery.${status}`)}
            </p>
          </section>
        );
      })}
    </div>
  );
}
