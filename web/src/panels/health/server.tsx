/** The server: its clients, what it drops and why, how loaded it is, by its own metrics; and this connection. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Problem } from "../../forms/problem";
import { clockText, fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { seconds } from "../../robot/names";
import type { Message } from "../../robot/subscriptions";
import { componentPanel, now, useMessages } from "../component";
import type { PanelContext, PanelKind } from "../registry";

/** Milliseconds between two looks. */
const PERIOD = 2000;
/** Milliseconds that a look may take. */
const PATIENCE = 10_000;

/** One line of the metrics: name, labels, value. */
export interface Sample {
  name: string;
  labels: Record<string, string>;
  value: number;
}

export const server: PanelKind = {
  name: "server",
  title: "server.title",
  supportedTypes: ["rosbridge_msgs/ConnectedClients"],
  opens: (session) => session.topicsOf("rosbridge_msgs/ConnectedClients").length > 0,
  place: "below",
  needsRobot: true,
  init: componentPanel(ServerPanel),
};

/** The samples of a text in the format of Prometheus. */
export function readMetrics(text: string): Sample[] {
  const samples: Sample[] = [];
  for (const line of text.split("\n")) {
    const found = /^([a-zA-Z_:][\w:]*)(?:\{(.*)\})? (\S+)$/.exec(line);
    if (!found) continue;
    const labels: Record<string, string> = {};
    for (const [, name, value] of (found[2] ?? "").matchAll(/(\w+)="((?:[^"\\]|\\.)*)"/g)) {
      if (name)
        labels[name] = (value ?? "").replace(/\\(.)/g, (_, char: string) => (char === "n" ? "\n" : char));
    }
    samples.push({ name: found[1] as string, labels, value: Number(found[3]) });
  }
  return samples;
}

interface Client {
  ip_address: string;
  connection_time: unknown;
}

function ServerPanel({ context }: { context: PanelContext }) {
  const { session, visible } = context;
  const clients = useSignal<Client[]>([]);
  const metrics = useSignal<Sample[]>([]);
  const problem = useSignal("");
  const topic = session.topicsOf("rosbridge_msgs/ConnectedClients")[0] ?? "";
  const isVisible = visible.value;
  const take = (message: Message) => {
    clients.value = (message.clients as Client[] | undefined) ?? [];
  };
  useMessages(session, topic, take, { isOn: isVisible });
  useEffect(() => {
    if (!isVisible) return undefined;
    let isAsking = false;
    const look = async () => {
      // Requests that are not answered must not add up: a browser has six at a time.
      if (isAsking) return;
      isAsking = true;
      try {
        const response = await fetch(new URL("metrics", session.httpBase), {
          headers: session.httpHeaders,
          signal: AbortSignal.timeout(PATIENCE),
        });
        const text = await response.text();
        if (!response.ok) throw new Error(text.trim());
        metrics.value = readMetrics(text);
        problem.value = "";
      } catch (error) {
        problem.value = t("server.closed", { reason: (error as Error).message });
      }
      isAsking = false;
    };
    void look();
    const timer = setInterval(look, PERIOD);
    return () => clearInterval(timer);
  }, [session, isVisible, metrics, problem]);
  const total = (name: string) =>
    metrics.value.filter((each) => each.name === name).reduce((sum, { value }) => sum + value, 0);
  const lag = total("rwt_loop_lag_seconds_sum") / total("rwt_loop_lag_seconds_count");
  const dropped = metrics.value.filter(
    ({ name, value }) => name === "rwt_topic_dropped_messages_total" && value > 0,
  );
  const role = session.permissions.value.role;
  const up = session.connectedAt.value ? (now.value - session.connectedAt.value) / 1000 : 0;
  return (
    <div class="server">
      <table>
        <tbody>
          <tr>
            <th scope="row">{t("server.address")}</th>
            <td>{session.url}</td>
          </tr>
          <tr>
            <th scope="row">{t("state.open")}</th>
            <td>{t("server.since", { seconds: fixed(up, 0), count: session.connections.value })}</td>
          </tr>
          {role && (
            <tr>
              <th scope="row">{t("server.role")}</th>
              <td>{role}</td>
            </tr>
          )}
          {metrics.value.length > 0 && (
            <>
              <tr>
                <th scope="row">{t("server.clients")}</th>
                <td>{total("rwt_clients")}</td>
              </tr>
              <tr>
                <th scope="row">{t("server.messages")}</th>
                <td>
                  {total("rwt_received_messages_total")} / {total("rwt_sent_messages_total")}
                </td>
              </tr>
              <tr>
                <th scope="row">{t("server.lag")}</th>
                <td>{Number.isFinite(lag) ? `${fixed(lag * 1000, 2)} ms` : "–"}</td>
              </tr>
              <tr>
                <th scope="row">{t("server.dropped")}</th>
                <td>{total("rwt_topic_dropped_messages_total")}</td>
              </tr>
            </>
          )}
        </tbody>
      </table>
      {problem.value && <Problem text={problem.value} />}
      {dropped.length > 0 && (
        <ul class="names">
          {dropped.map(({ labels, value }) => (
            <li key={JSON.stringify(labels)}>
              {Object.values(labels).join(" · ")}: {value}
            </li>
          ))}
        </ul>
      )}
      {clients.value.length > 0 && (
        <table>
          <thead>
            <tr>
              <th scope="col">{t("server.address")}</th>
              <th scope="col">{t("state.open")}</th>
            </tr>
          </thead>
          <tbody>
            {clients.value.map(({ ip_address, connection_time }) => (
              <tr key={`${ip_address} ${seconds(connection_time)}`}>
                <td>{ip_address}</td>
                <td>{clockText(seconds(connection_time) * 1000)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
    </div>
  );
}
