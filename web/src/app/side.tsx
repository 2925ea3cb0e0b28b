/** Topics with their rates, a switch for those that 3D draws, and a search for topics and panels. */

import { useComputed, useSignal } from "@preact/signals";
import { Eye, EyeOff } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { Icon } from "../forms/icon";
import { Search } from "../forms/inputs";
import { t } from "../i18n/text";
import { rateText } from "../panels/graph/topics";
import { panelIcon } from "../panels/icons";
import { panelKinds } from "../panels/registry";
import { shortType } from "../robot/names";
import type { RobotSession } from "../robot/session";
import { isDrawable, isDrawn } from "../scene/drawable";
import type { App } from "./state";

/** Rows at a time: a robot may have ten thousand topics. */
const MOST_ROWS = 150;

const GROUPS = [
  ["sensors", /^(sensor|stereo|radar|point_cloud)_msgs\/(?!Joint|Battery)/],
  ["navigation", /^(nav|nav2|map|geometry|move_base|actionlib)_msgs\//],
  ["display", /^visualization_msgs\//],
  ["robot", /^/],
] as const;

type Row = readonly [name: string, type: string];

export function Side({ app }: { app: App }) {
  const { session } = app;
  const search = useSignal("");
  const onlyDrawn = useSignal(false);
  const current = useSignal("");
  const host = useRef<HTMLElement>(null);
  const found = useComputed(() => {
    const wanted = search.value.toLowerCase();
    return [...session.graph.value.topics]
      .filter(([name, type]) => !onlyDrawn.value || isDrawable(name, type))
      .filter(([name, type]) =>
        wanted ? `${name} ${type}`.toLowerCase().includes(wanted) : !name.includes("/_action/"),
      )
      .sort(([one], [other]) => (one < other ? -1 : 1));
  });
  const rows = found.value.slice(0, MOST_ROWS);
  const names = rows.map(([name]) => name);
  useEffect(() => session.rates.watch(names), [session, names.join("\n")]);
  useEffect(() => {
    const key = (event: KeyboardEvent) => {
      if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "k") return;
      event.preventDefault();
      app.showSide(true);
      queueMicrotask(() => host.current?.querySelector("input")?.focus());
    };
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, [app]);
  if (!app.side.value) return null;
  const panels = search.value
    ? panelKinds().filter(({ title }) => t(title).toLowerCase().includes(search.value.toLowerCase()))
    : [];
  // One row has the tabulator; arrow keys go to the others.
  const chosen = names.includes(current.value) ? current.value : (names[0] ?? "");
  const step = (event: KeyboardEvent) => {
    const at = names.indexOf(chosen) + (event.key === "ArrowDown" ? 1 : event.key === "ArrowUp" ? -1 : 0);
    const next = names[at];
    if (next === undefined || next === chosen) return;
    event.preventDefault();
    current.value = next;
    queueMicrotask(() => host.current?.querySelector<HTMLElement>('.topic-name[tabindex="0"]')?.focus());
  };
  const shown = GROUPS.map(([name, fits], at) => {
    const earlier = GROUPS.slice(0, at);
    const members = rows.filter(([, type]) => {
      const short = shortType(type);
      return fits.test(short) && !earlier.some(([, other]) => other.test(short));
    });
    return { name, members };
  });
  return (
    <aside class="side" aria-label={t("side.title")} ref={host}>
      <div class="side-search">
        <Search text={search} />
        <span class="kbd" aria-hidden="true">
          Ctrl K
        </span>
      </div>
      <fieldset class="seg" aria-label={t("side.show")}>
        {[false, true].map((drawn) => (
          <button
            type="button"
            key={String(drawn)}
            aria-pressed={onlyDrawn.value === drawn}
            onClick={() => {
              onlyDrawn.value = drawn;
            }}
          >
            {t(drawn ? "scene.layers" : "topics.title")}
          </button>
        ))}
      </fieldset>
      <div class="side-list">
        {panels.length > 0 && (
          <section>
            <h2 class="group">{t("app.panels")}</h2>
            {panels.map(({ name, title }) => (
              <button type="button" class="plain side-panel" key={name} onClick={() => app.open(name)}>
                <Icon of={panelIcon(name)} size={16} /> {t(title)}
              </button>
            ))}
          </section>
        )}
        {shown.map(
          ({ name, members }) =>
            members.length > 0 && (
              <section key={name}>
                <h2 class="group">
                  {t(`side.${name}`)} <span class="number">{members.length}</span>
                </h2>
                {members.map((row) => (
                  <TopicRow key={row[0]} {...{ app, row, step }} isCurrent={row[0] === chosen} />
                ))}
              </section>
            ),
        )}
        {found.value.length > rows.length && (
          <p class="faint">{t("topics.more", { count: found.value.length - rows.length })}</p>
        )}
        {rows.length === 0 && session.hasAsked && <p class="blank">{t("side.none")}</p>}
      </div>
    </aside>
  );
}

function TopicRow(props: { app: App; row: Row; isCurrent: boolean; step: (event: KeyboardEvent) => void }) {
  const { app, row, isCurrent, step } = props;
  const [name, type] = row;
  const { session } = app;
  const short = shortType(type);
  const tabIndex = isCurrent ? 0 : -1;
  const isShown = isDrawn(name, app.layers.value ?? {});
  const isChosen = app.panels.value.some(({ kind, config }) => kind === "topics" && config.topic === name);
  return (
    <div class={isChosen ? "topic chosen" : "topic"}>
      {isDrawable(name, type) && app.layers.value ? (
        <button
          type="button"
          class="eye"
          tabIndex={tabIndex}
          aria-pressed={isShown}
          aria-label={t("side.draw", { name })}
          title={t("side.draw", { name })}
          onKeyDown={step}
          onClick={() => app.draw(name, !isShown)}
        >
          <Icon of={isShown ? Eye : EyeOff} size={16} />
        </button>
      ) : (
        <span />
      )}
      <button
        type="button"
        class="plain topic-name"
        tabIndex={tabIndex}
        title={`${name} · ${short}`}
        onKeyDown={step}
        onClick={() => app.inspect(name)}
      >
        <b>{name}</b>
        <small>{short.slice(short.indexOf("/") + 1)}</small>
      </button>
      <Sparkline session={session} name={name} />
      <span class="rate">{rateText(session, name)}</span>
    </div>
  );
}

/** The last rates of a topic as a line. */
function Sparkline({ session, name }: { session: RobotSession; name: string }) {
  const past = session.rates.known.value.get(name)?.past ?? [];
  if (past.length < 2) return <span />;
  const most = Math.max(...past, 1e-9);
  const points = past.map((hz, at) => `${(at / (past.length - 1)) * 36 + 1},${14 - (hz / most) * 11}`);
  return (
    <svg class="spark" viewBox="0 0 38 16" aria-hidden="true">
      <polyline points={points.join(" ")} />
    </svg>
  );
}
