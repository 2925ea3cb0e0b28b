/** The robot's log, as it comes on /rosout. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Check, Choice, Search } from "../../forms/inputs";
import { clockText } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { seconds } from "../../robot/names";
import { componentPanel, Needs, useMessages } from "../component";
import type { PanelContext, PanelKind } from "../registry";

const TYPES = ["rcl_interfaces/Log", "rosgraph_msgs/Log"];
const LEVELS = ["debug", "info", "warning", "error", "fatal"] as const;
const MOST = 2000;
const MOST_SHOWN = 400;
/** Nodes among which one can be chosen. */
const MOST_NODES = 500;
/** Milliseconds between two drawings: a log can be a flood. */
const REDRAW = 150;

interface Entry {
  number: number;
  stamp: number;
  level: number;
  name: string;
  text: string;
}

export const log: PanelKind = {
  name: "log",
  title: "log.title",
  supportedTypes: TYPES,
  opens: (session) => session.topicsOf(...TYPES).length > 0,
  place: "below",
  init: componentPanel(LogPanel),
};

/** The place in LEVELS of a level: ROS 2 counts 10, 20 … 50, ROS 1 1, 2, 4, 8, 16. */
export function logLevel(level: number): number {
  const place = level >= 10 && level % 10 === 0 ? level / 10 - 1 : Math.round(Math.log2(level));
  return Math.max(0, Math.min(4, place || 0));
}

function LogPanel({ context }: { context: PanelContext }) {
  const { session, config } = context;
  const topic = session.topicsOf(...TYPES)[0] ?? "";
  const entries = useRef<Entry[]>([]);
  const shown = useSignal(0);
  const follow = useSignal(true);
  const search = useSignal("");
  const list = useRef<HTMLDivElement>(null);
  const least = Number(config.value.level ?? 1);
  const count = useRef(0);
  const names = useRef(new Set<string>());
  useMessages(session, topic, (message) => {
    const stamp = seconds(message.stamp ?? (message.header as { stamp?: unknown } | undefined)?.stamp);
    if (names.current.size < MOST_NODES) names.current.add(String(message.name));
    entries.current.push({
      number: ++count.current,
      stamp,
      level: logLevel(Number(message.level)),
      name: String(message.name),
      text: String(message.msg),
    });
    if (entries.current.length > MOST) entries.current.splice(0, entries.current.length - MOST);
  });
  useEffect(() => {
    const timer = setInterval(() => {
      shown.value = count.current;
    }, REDRAW);
    return () => clearInterval(timer);
  }, [shown]);
  shown.value;
  const wanted = search.value.toLowerCase();
  const node = String(config.value.node ?? "");
  const nodes = [...new Set([...names.current, ...(node ? [node] : [])])].sort();
  const found = entries.current.filter(
    (each) =>
      each.level >= least &&
      (!node || each.name === node) &&
      `${each.name} ${each.text}`.toLowerCase().includes(wanted),
  );
  useEffect(() => {
    if (follow.value && list.current) list.current.scrollTop = list.current.scrollHeight;
  });
  if (!topic) return <Needs kind={log} />;
  return (
    <div class="log">
      <div class="plot-bar">
        <Choice
          label={t("log.level")}
          chosen={String(least)}
          options={LEVELS.map((name, at) => [String(at), t(`log.${name}`)])}
          onChoose={(level) => {
            config.value = { ...config.value, level: Number(level) };
          }}
        />
        <Choice
          label={t("parameters.node")}
          quiet
          chosen={node}
          options={[["", t("log.nodes")], ...nodes.map((name) => [name, name] as const)]}
          onChoose={(name) => {
            config.value = { ...config.value, node: name };
          }}
        />
        <Search text={search} />
        <Check
          checked={follow.value}
          onChange={(checked) => {
            follow.value = checked;
          }}
        >
          {t("log.follow")}
        </Check>
      </div>
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls must be reached by the keyboard. */}
      <div class="log-entries" ref={list} role="log" tabIndex={0} aria-label={t("log.title")}>
        {entries.current.length === 0 && <p class="faint">{t("log.none")}</p>}
        {found.slice(-MOST_SHOWN).map(({ number, stamp, level, name, text }) => (
          <p key={number} class={`log-${LEVELS[level]}`}>
            <span class="faint">{clockText(stamp * 1000, 3)}</span>{" "}
            <b>{t(`log.${LEVELS[level] ?? "info"}`)}</b> <span class="faint">{name}</span>{" "}
            <span class="log-text">{text}</span>
          </p>
        ))}
      </div>
    </div>
  );
}
