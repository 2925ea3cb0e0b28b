/** Nodes: who talks to whom, as a picture and as lists. */

import { useSignal } from "@preact/signals";
import { ZoomIn, ZoomOut } from "lucide";
import { useEffect, useId } from "preact/hooks";
import { IconButton } from "../../forms/icon";
import { Check, Choice, NameButton } from "../../forms/inputs";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { keepAsking } from "../../robot/asking";
import type { PanelContext } from "../registry";

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
/** Where the topics stand, and half of the room that a name takes beside it, about. */
const MIDDLE = 460;
const half = (topic: string) => Math.min(130, 18 + topic.length * 3.7);
/** Factors by which the picture can be drawn; the style has a width for each. */
const ZOOMS = [0.5, 0.75, 1, 1.5, 2, 3];

/**
 * The topics over which nodes reach each other, with those at either end; of one node, where one is chosen.
 *
 * @param all true for topics without publishers or without subscribers as well
 */
export function talks(details: ReadonlyMap<string, NodeDetails>, chosen: string, all = false) {
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
    .filter(({ from, to }) =>
      chosen ? [...from, ...to].includes(chosen) : all || (from.length > 0 && to.length > 0),
    )
    .sort((one, other) => (one.topic < other.topic ? -1 : 1));
}

export function Panel({ context }: { context: PanelContext }) {
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
  const all = config.value.all === true;
  const zoom = useSignal(ZOOMS.indexOf(1));
  const one = details.value.get(chosen);
  return (
    <div class="nodes">
      <div class="plot-bar">
        <Choice
          label={t("parameters.node")}
          chosen={chosen}
          options={[["", t("nodes.all")], ...[...names].sort()]}
          onChoose={(node) => {
            config.value = { ...config.value, node };
          }}
        />
        <Check
          checked={all}
          onChange={(checked) => {
            config.value = { ...config.value, all: checked };
          }}
        >
          {t("nodes.dead_ends")}
        </Check>
        {([-1, 1] as const).map((step) => (
          <IconButton
            key={step}
            of={step < 0 ? ZoomOut : ZoomIn}
            name={t(step < 0 ? "plot.zoom.out" : "plot.zoom.in")}
            size={16}
            class="tip-below"
            disabled={ZOOMS[zoom.value + step] === undefined}
            onClick={() => {
              zoom.value += step;
            }}
          />
        ))}
      </div>
      {problem.value && <Problem text={problem.value} />}
      <Picture details={details.value} chosen={chosen} all={all} zoom={zoom.value} />
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
function Picture(props: {
  details: ReadonlyMap<string, NodeDetails>;
  chosen: string;
  all: boolean;
  /** Place among {@link ZOOMS}. */
  zoom: number;
}) {
  const { details, chosen, all, zoom } = props;
  const found = talks(details, chosen, all);
  const shown = found.slice(0, MOST_ROWS);
  const left = [...new Set(shown.flatMap(({ from }) => from))].sort();
  const right = [...new Set(shown.flatMap(({ to }) => to))].sort();
  const rows = Math.max(left.length, shown.length, right.length, 1);
  const arrow = useId();
  const y = (at: number, of: number) => ((at + 0.5) * rows * ROW) / Math.max(of, 1);
  if (!shown.length) return <p class="faint">{t("nodes.none")}</p>;
  return (
    <>
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: arrow keys scroll only what has the focus. */}
      <div class="nodes-picture" tabIndex={0}>
        <svg
          viewBox={`0 0 ${WIDTH} ${rows * ROW}`}
          class={`zoom-${zoom}`}
          role="img"
          aria-label={t("nodes.picture", { count: shown.length })}
        >
          <marker
            id={arrow}
            viewBox="0 0 8 8"
            refX="7"
            refY="4"
            markerWidth="8"
            markerHeight="8"
            orient="auto"
          >
            <path d="M 0 0 L 8 4 L 0 8 z" />
          </marker>
          {shown.flatMap(({ topic, from, to }, at) => [
            ...from.map((node) => (
              <line
                key={`${node} ${topic}`}
                x1={230}
                y1={y(left.indexOf(node), left.length)}
                marker-end={`url(#${arrow})`}
                x2={MIDDLE - half(topic)}
                y2={y(at, shown.length)}
              />
            )),
            ...to.map((node) => (
              <line
                key={`${topic} ${node}`}
                x1={MIDDLE + half(topic)}
                y1={y(at, shown.length)}
                marker-end={`url(#${arrow})`}
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
          {shown.map(({ topic, from, to }, at) => {
            const isDead = !from.length || !to.length;
            const end = from.length ? "nodes.unheard" : "nodes.unsaid";
            return (
              <text
                key={topic}
                x={MIDDLE}
                y={y(at, shown.length) + 5}
                text-anchor="middle"
                class={isDead ? "topic dead" : "topic"}
              >
                {isDead && <title>{t(end)}</title>}
                {isDead ? `⊘ ${topic}` : topic}
              </text>
            );
          })}
          {right.map((node, at) => (
            <text key={node} x={685} y={y(at, right.length) + 5} class={node === chosen ? "chosen" : ""}>
              {node}
            </text>
          ))}
        </svg>
      </div>
      {found.length > shown.length && (
        <p class="faint">{t("topics.longer", { count: found.length - shown.length })}</p>
      )}
    </>
  );
}
