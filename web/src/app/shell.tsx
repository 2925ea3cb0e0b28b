/** The page around the panels: the robot's state, the stop, menus, and what the robot has to say. */

import { type Signal, useComputed, useSignal } from "@preact/signals";
import { Accessibility, Bot, LayoutDashboard, Moon, OctagonX, PanelLeft, Plus, Sun } from "lucide";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { Icon, IconButton } from "../forms/icon";
import { useLater } from "../forms/later";
import { Menu } from "../forms/menu";
import { useNarrow } from "../forms/narrow";
import { Problem } from "../forms/problem";
import { fixed } from "../i18n/formats";
import { t } from "../i18n/text";
import { panelIcon } from "../panels/icons";
import { panelKinds } from "../panels/registry";
import { Banners } from "./banners";
import { ConnectForm, TokenForm } from "./connect";
import { BatteryFact, ClockFact, DriverFact, Footer, RecordingFact, RoleFact } from "./facts";
import { LayoutMenu } from "./layout_menu";
import { RobotMenu } from "./robots";
import { ScanBar } from "./scan";
import { Side } from "./side";
import type { App } from "./state";
import { Tabs } from "./tabs";
import { Timeline } from "./timeline";

/** What unfolds over the page and is folded by Escape. */
const OPEN_MENU = ".dropdown[open], .menu:popover-open, .suggest-list:popover-open, .marker-menu";

export function Shell({ app }: { app: App }) {
  const narrow = useNarrow();
  const isDropping = useSignal(false);
  useLayoutEffect(() => {
    if (app.recording) return undefined;
    const key = (event: KeyboardEvent) => {
      if (event.key !== "Escape") return;
      // An open menu only closes, by its own listener, while this page can have nothing in motion.
      if (app.mayBeMoving() || !document.querySelector(OPEN_MENU)) app.stop.stop();
    };
    // Before every other control: whatever has the focus, a menu or a tool, the robot stops.
    addEventListener("keydown", key, { capture: true });
    return () => removeEventListener("keydown", key, { capture: true });
  }, [app]);
  useEffect(() => takeDrops(app, isDropping), [app, isDropping]);
  const { session } = app;
  // A recording cannot be stopped: a control that does nothing would be trusted.
  const stop = app.recording ? null : <StopButton app={app} />;
  return (
    <>
      {isDropping.value && <p class="drop">{t("recording.drop")}</p>}
      <a class="skip" href="#panels">
        {t("app.skip")}
      </a>
      <header>
        {!narrow && stop}
        <div class="robot">
          <span class="robot-mark">
            <Icon of={Bot} size={20} />
          </span>
          <div>
            <h1 title={session.url}>{app.name.value}</h1>
            {session.state.value === "open" && (
              <small>
                ROS {session.version.value} {session.distro.value}
              </small>
            )}
          </div>
        </div>
        {!app.recording && <State app={app} />}
        <BatteryFact app={app} />
        <DriverFact app={app} />
        <span class="grow" />
        <RecordingFact app={app} />
        <ClockFact session={session} />
        <nav class="menus">
          {app.settings.robots && <RobotMenu url={app.settings.robots} />}
          {!narrow && (
            <IconButton
              of={PanelLeft}
              name={t("topics.title")}
              class="tip-below"
              aria-pressed={app.side.value}
              onClick={() => app.showSide(!app.side.value)}
            />
          )}
          <Menu label={t("app.add")} icon={Plus}>
            {(close) => <PanelMenu app={app} close={close} />}
          </Menu>
          <Menu label={t("app.layouts")} icon={LayoutDashboard}>
            {(close) => <LayoutMenu app={app} close={close} />}
          </Menu>
          <IconButton
            of={Accessibility}
            name={t("scan.switch")}
            class="tip-below"
            data-scan="press"
            aria-pressed={app.scanning.value}
            onClick={() => {
              app.scanning.value = !app.scanning.value;
            }}
          />
          <IconButton
            of={app.dark.value ? Sun : Moon}
            name={t("app.theme")}
            class="tip-below"
            onClick={() => app.setTheme(app.dark.value ? "light" : "dark")}
          />
        </nav>
        <RoleFact session={session} />
      </header>
      {app.scanning.value && <ScanBar app={app} />}
      {!app.recording && <Banners app={app} />}
      <div class="body">
        {!narrow && <Side app={app} />}
        <main id="panels" tabIndex={-1}>
          {session.state.value === "refused" && <TokenForm app={app} />}
          {session.connections.value === 0 && session.state.value === "lost" && <ConnectForm app={app} />}
          {session.graph.value.problem && session.state.value === "open" && (
            <p class="problem" role="status">
              {t("discovery.problem", { reason: session.graph.value.problem })}
            </p>
          )}
          {session.connections.value === 0 && session.state.value === "connecting" && (
            <p class="waiting">{t("state.connecting")}…</p>
          )}
          {session.hasAsked && app.panels.value.length === 0 && <NoPanels app={app} />}
          {narrow ? <Tabs app={app} stop={stop} /> : <Dock app={app} />}
        </main>
      </div>
      {app.recording && <Timeline app={app} />}
      <Notices app={app} />
    </>
  );
}

/** Open recordings that are dropped on the page; returns what ends it. */
function takeDrops(app: App, isDropping: Signal<boolean>): () => void {
  const drag = (event: DragEvent) => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    // Otherwise the browser would leave the page, and with it the robot.
    event.preventDefault();
    isDropping.value = event.type === "dragover";
    const [file] = event.type === "drop" ? event.dataTransfer.files : [];
    if (file) app.openRecording(file);
  };
  const kinds = ["dragover", "dragleave", "drop"] as const;
  for (const kind of kinds) addEventListener(kind, drag);
  return () => {
    for (const kind of kinds) removeEventListener(kind, drag);
  };
}

function StopButton({ app }: { app: App }) {
  const { stop, session } = app;
  const reaches = useComputed(() => stop.reaches);
  const { topics, actions } = reaches.value;
  const nothing = session.state.value === "open" && topics.length === 0 && actions.length === 0;
  const stopped = stop.stopped.value;
  // Pressed again, it sends the stop again; another control releases it.
  return (
    <button
      type="button"
      class={stopped ? "stop latched" : "stop"}
      data-scan="press"
      title={nothing ? t("stop.nothing") : t("stop.hint")}
      aria-keyshortcuts="Escape"
      onClick={() => stop.stop()}
    >
      <Icon of={OctagonX} size={22} />
      {t(stopped ? "stop.latched" : "stop.stop")}
    </button>
  );
}

function State({ app }: { app: App }) {
  const { state, reason, silence, trip } = app.session;
  if (silence.value > 0) {
    const seconds = fixed(silence.value / 1000, 1);
    return (
      <p class="state state-silent" role="status">
        <span class="dot" aria-hidden="true" />
        <span class="hidden">{t("state.silent")}</span>
        {/* A screen reader would say every tenth of a second. */}
        <span aria-hidden="true">{t("state.silent.for", { seconds })}</span>
      </p>
    );
  }
  return (
    <p class={`state state-${state.value}`} role="status" title={reason.value}>
      <span class="dot" aria-hidden="true" />
      <span>
        {t(`state.${state.value}`)}
        {trip.value > 0 && (
          // A screen reader would say every change.
          <small aria-hidden="true">
            {t("fact.trip", { milliseconds: Math.max(1, Math.round(trip.value)) })}
          </small>
        )}
      </span>
    </p>
  );
}

/** Actions offered while every panel is closed. */
function NoPanels({ app }: { app: App }) {
  return (
    <section class="card no-panels blank">
      <Icon of={LayoutDashboard} size={28} />
      <b>{t("layout.empty")}</b>
      <p>{t("layout.empty.hint")}</p>
      <Menu label={t("app.add")}>{(close) => <PanelMenu app={app} close={close} />}</Menu>
      <button type="button" onClick={() => app.show(app.suggested())}>
        {t("layout.reset")}
      </button>
    </section>
  );
}

function PanelMenu({ app, close }: { app: App; close: () => void }) {
  return (
    <ul>
      {panelKinds().map(({ name, title }) => (
        <li key={name}>
          <button
            type="button"
            data-kind={name}
            onClick={() => {
              close();
              app.open(name);
            }}
          >
            <Icon of={panelIcon(name)} size={16} /> {t(title)}
          </button>
        </li>
      ))}
    </ul>
  );
}

function Dock({ app }: { app: App }) {
  const place = useRef<HTMLDivElement>(null);
  const problem = useLater(
    () => import("./dock"),
    ({ dockPanels }) => dockPanels(app, place.current as HTMLElement),
    [app],
  );
  return (
    <>
      {problem && <Problem text={problem} />}
      <div class="dock" ref={place} />
    </>
  );
}

/** The last message in a row of its own, which covers no control and has its height from the start. */
function Notices({ app }: { app: App }) {
  const dismissed = useSignal(0);
  const unfolded = useSignal(false);
  const { session } = app;
  const blocked = session.commands.lastBlocked.value;
  const notices = session.notices.value.filter(({ number }) => number > dismissed.value);
  const shown = unfolded.value ? notices : notices.slice(-1);
  return (
    <aside class="notices" aria-live="polite" aria-label={t("app.notices")}>
      <div class="notice-list">
        {blocked && (
          <p key={`blocked ${blocked.number}`} class="notice notice-warning">
            {t("blocked.notice", { name: blocked.name, reason: t(`blocked.${blocked.why}`) })}
          </p>
        )}
        {(unfolded.value || !blocked) &&
          shown.map(({ number, level, text, count }) => (
            <p key={number} class={`notice notice-${level}`} title={text}>
              {text} {count > 1 && <span class="faint">× {count}</span>}
            </p>
          ))}
      </div>
      {notices.length > 1 && (
        <button
          type="button"
          aria-expanded={unfolded.value}
          onClick={() => {
            unfolded.value = !unfolded.value;
          }}
        >
          {unfolded.value ? t("app.fewer") : t("app.all", { count: notices.length })}
        </button>
      )}
      {(blocked || notices.length > 0) && (
        <button
          type="button"
          onClick={() => {
            session.commands.lastBlocked.value = null;
            dismissed.value = notices.at(-1)?.number ?? 0;
            unfolded.value = false;
          }}
        >
          {t("app.dismiss")}
        </button>
      )}
      <Footer session={session} />
    </aside>
  );
}
