/** Nodes: who talks to whom, as a picture and as lists. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Choice, NameButton } from "../../forms/inputs";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { keepAsking } from "../../robot/asking";
import { componentPanel } from "../component";
import type { PanelContext, PanelKind } from "../registry";

/** Topics and services of a node, as rosapi reports them. */
export interface NodeDetails {
  publishing: string[];
  subscribing: string[];
  services: string[];
}

/** Topics that nearly every node has: they would hide the rest. */
const EVERYWHERE = new Set(["/rosout", "/parameter_events", "/clock"]);
const MOST_NODES = 100;
const MOST_ROWS = 40;
const ROW = 26;
const WIDTH = 900;

export const nodes: PanelKind = {
  name: "nodes",
  title: "nodes.title",
  supportedTypes: [],
  opens: (session) => session.graph.value.nodes.length > 0,
  place: "below",
  init: componentPanel(NodesPanel),
};

/** The topics over which nodes reach each other, with those at either end; of one node, where one is chosen. */
export function talks(details: ReadonlyMap<string, NodeDetails>, chosen: string) {
  const topics = new Map<string, { from: string[]; to: string[] }>();
  const at = (name: string) => {
    const known = topics.get(name) ?? { from: [], to: [] };
    topics.set(name, known);
    return known;
  };
  for (const [node, { publishing, subscribing }] of details) {
    for (const topic of publishing) if (!EVERYWHERE.has(topic)) at(topic).from.push(node);
    for (const topic of subscribing) if (!EVERYWHERE.has(topic)) at(topic).to.push(node);
  }
  return [...topics]
    .map(([topic, ends]) => ({ topic, ...ends }))
    .filter(({ from, to }) => (chosen ? [...from, ...to].includes(chosen) : from.length > 0 && to.length > 0))
    .sort((one, other) => (one.topic < other.topic ? -1 : 1));
}

function NodesPanel({ context }: { context: PanelContext }) {
  const { session, config, visible } = context;
  const details = useSignal(new Map<string, NodeDetails>());
  const problem = useSignal("");
  const names = session.graph.value.nodes.slice(0, MOST_NODES);
  const key = `${names.join(" ")} ${session.graph.value.topics.size}`;
  const isVisible = visible.value;
  // Asked again when nodes or topics come or go.
  useEffect(() => {
    if (!isVisible) return undefined;
    const ask = async (node: string) =>
      [node, await session.call<NodeDetails>("/rosapi/node_details", { node })] as const;
    return keepAsking(
      session,
      () => Promise.all(names.map(ask)),
      (all) => {
        details.value = new Map(all);
      },
      (reason) => {
        problem.value = reason;
      },
    );
  }, [session, key, isVisible]);
  const chosen = String(config.value.node ?? "");
  const one = details.value.get(chosen);
  return (
    <div class="nodes">
      <Choice
        label={t("parameters.node")}
        chosen={chosen}
        options={[["", t("nodes.all")], ...[...names].sort()]}
        onChoose={(node) => {
          config.value = { ...config.value, node };
        }}
      />
      {problem.value && <Problem text={problem.value} />}
      <Picture details={details.value} chosen={chosen} />
      {one &&
        (["publishing", "subscribing", "services"] as const).map((kind) => (
          <details key={kind}>
            <summary>
              {t(`nodes.${kind}`)} ({one[kind].length})
            </summary>
            <ul class="names">
              {one[kind].map((name) => (
                <li key={name}>
                  {kind === "services" ? (
                    name
                  ) : (
                    <NameButton name={name} onChoose={() => context.open("topics", { topic: name })} />
                  )}
                </li>
              ))}
            </ul>
          </details>
        ))}
    </div>
  );
}

/** Three columns: who publishes, on what, and who hears it. */
function Picture({ details, chosen }: { details: ReadonlyMap<string, NodeDetails>; chosen: string }) {
  const all = talks(details, chosen);
  const shown = all.slice(0, MOST_ROWS);
  const left = [...new Set(shown.flatMap(({ from }) => from))].sort();
  const right = [...new Set(shown.flatMap(({ to }) => to))].sort();
  const rows = Math.max(left.length, shown.length, right.length, 1);
  const y = (at: number, of: number) => ((at + 0.5) * rows * ROW) / Math.max(of, 1);
  if (!shown.length) return <p class="faint">{t("nodes.none")}</p>;
  return (
    <>
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: arrow keys scroll only what has the focus. */}
      <div class="nodes-picture" tabIndex={0}>
        <svg
          viewBox={`0 0 ${WIDTH} ${rows * ROW}`}
          role="img"
          aria-label={t("nodes.picture", { count: shown.length })}
        >
          {shown.flatMap(({ topic, from, to }, at) => [
            ...from.map((node) => (
              <line
                key={`${node} ${topic}`}
                x1={230}
                y1={y(left.indexOf(node), left.length)}
                x2={330}
                y2={y(at, shown.length)}
              />
            )),
            ...to.map((node) => (
              <line
                key={`${topic} ${node}`}
                x1={590}
                y1={y(at, shown.length)}
                x2={680}
                y2={y(right.indexOf(node), right.length)}
              />
            )),
          ])}
          {left.map((node, at) => (
            <text
              key={node}
              x={225}
              y={y(at, left.length) + 5}
              text-anchor="end"
              class={node === chosen ? "chosen" : ""}
            >
              {node}
            </text>
          ))}
          {shown.map(({ topic }, at) => (
            <text key={topic} x={460} y={y(at, shown.length) + 5} text-anchor="middle" class="topic">
              {topic}
            </text>
          ))}
          {right.map((node, at) => (
            <text key={node} x={685} y={y(at, right.length) + 5} class={node === chosen ? "chosen" : ""}>
              {node}
            </text>
          ))}
        </svg>
      </div>
      {all.length > shown.length && (
        <p class="faint">{t("topics.longer", { count: all.length - shown.length })}</p>
      )}
    </>
  );
}
