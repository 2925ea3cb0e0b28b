/** The page around the panels: the robot's state, the stop, menus, and what the robot has to say. */

import { useComputed, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { stopText } from "../forms/gate";
import { useLater } from "../forms/later";
import { Menu } from "../forms/menu";
import { Problem } from "../forms/problem";
import { t } from "../i18n/text";
import { panelKinds } from "../panels/registry";
import { ConnectForm, TokenForm } from "./connect";
import { LayoutMenu } from "./layout_menu";
import { ScanBar } from "./scan";
import type { App } from "./state";
import { Tabs } from "./tabs";

/** Screens that are narrower show one panel at a time. */
const NARROW = "(max-width: 760px)";

export function Shell({ app }: { app: App }) {
  const narrow = useSignal(matchMedia(NARROW).matches);
  useEffect(() => {
    const query = matchMedia(NARROW);
    const change = () => {
      narrow.value = query.matches;
    };
    query.addEventListener("change", change);
    const key = (event: KeyboardEvent) => {
      if (event.key === "Escape") app.stop.stop();
    };
    addEventListener("keydown", key);
    return () => {
      query.removeEventListener("change", change);
      removeEventListener("keydown", key);
    };
  }, [app, narrow]);
  const { session } = app;
  return (
    <>
      <a class="skip" href="#panels">
        {t("app.skip")}
      </a>
      <header>
        <StopButton app={app} />
        <h1>{robotName(app)}</h1>
        <State app={app} />
        <nav class="menus">
          <Menu label={t("app.add")} sign="+">
            {(close) => <PanelMenu app={app} close={close} />}
          </Menu>
          <Menu label={t("app.layouts")} sign="▤">
            {(close) => <LayoutMenu app={app} close={close} />}
          </Menu>
          <button
            type="button"
            data-scan="press"
            aria-pressed={app.scanning.value}
            onClick={() => {
              app.scanning.value = !app.scanning.value;
            }}
          >
            <span class="sign" aria-hidden="true">
              ◉
            </span>
            <span class="words">{t("scan.switch")}</span>
          </button>
          <button type="button" onClick={() => app.setTheme(app.dark.value ? "light" : "dark")}>
            <span aria-hidden="true">{app.dark.value ? "☀" : "☾"}</span>
            <span class="hidden">{t("app.theme")}</span>
          </button>
        </nav>
      </header>
      {app.scanning.value && <ScanBar app={app} />}
      {app.stop.stopped.value && (
        <p class="stopped" role="status">
          {stopText(app.stop, t)}
        </p>
      )}
      <Senders app={app} />
      <Waiting app={app} />
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
        {narrow.value ? <Tabs app={app} /> : <Dock app={app} />}
      </main>
      <Notices app={app} />
    </>
  );
}

function robotName(app: App): string {
  const { host, pathname } = new URL(app.robot);
  return pathname === "/" ? host : host + pathname;
}

/** That clients wait for a person's yes, wherever the panel with it is. */
function Waiting({ app }: { app: App }) {
  const count = app.stop.gate.approvals.value.length;
  if (count === 0) return null;
  return (
    <p class="approvals-waiting" role="status">
      <button type="button" data-scan="press" onClick={() => app.open("approvals")}>
        {count === 1 ? t("approvals.waiting.one") : t("approvals.waiting", { count })}
      </button>
    </p>
  );
}

/** A light for each camera and microphone that the robot receives: who is seen or heard has to know. */
function Senders({ app }: { app: App }) {
  const senders = app.senders.value;
  if (senders.length === 0) return null;
  return (
    <div class="senders" role="status">
      {senders.map(({ topic, kind, client, role, since }) => (
        <p key={client + kind}>
          <span class="dot" aria-hidden="true" />
          {t(kind === "audio" ? "senders.audio" : "senders.video", {
            client,
            role,
            topic,
            since: new Date(since * 1000).toLocaleTimeString(),
          })}
        </p>
      ))}
    </div>
  );
}

function StopButton({ app }: { app: App }) {
  const { stop, session } = app;
  const reaches = useComputed(() => stop.reaches);
  const { topics, actions } = reaches.value;
  const nothing = session.state.value === "open" && topics.length === 0 && actions.length === 0;
  if (stop.stopped.value) {
    return (
      <button type="button" class="stop released" data-scan="press" onClick={() => stop.release()}>
        {t("stop.release")}
      </button>
    );
  }
  return (
    <button
      type="button"
      class="stop"
      data-scan="press"
      title={nothing ? t("stop.nothing") : t("stop.hint")}
      aria-keyshortcuts="Escape"
      onClick={() => stop.stop()}
    >
      {t("stop.stop")}
    </button>
  );
}

function State({ app }: { app: App }) {
  const { state, reason, permissions, distro, version, silence } = app.session;
  const role = permissions.value.role;
  if (silence.value > 0) {
    const seconds = (silence.value / 1000).toFixed(1);
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
      {t(`state.${state.value}`)}
      {state.value === "open" && <span class="faint"> · ROS {distro.value || version.value}</span>}
      {state.value === "open" && role && <span class="faint"> · {t("role.may", { role })}</span>}
    </p>
  );
}

function PanelMenu({ app, close }: { app: App; close: () => void }) {
  return (
    <ul>
      {panelKinds().map(({ name, title }) => (
        <li key={name}>
          <button
            type="button"
            onClick={() => {
              close();
              app.open(name);
            }}
          >
            {t(title)}
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

/** Notices that were there before the page was looked at are not shown again once dismissed. */
function Notices({ app }: { app: App }) {
  const dismissed = useSignal(0);
  const shown = app.session.notices.value.filter(({ number }) => number > dismissed.value).slice(-3);
  return (
    <aside class="notices" aria-live="polite" aria-label={t("app.notices")}>
      {shown.map(({ number, level, text }) => (
        <p key={number} class={`notice notice-${level}`}>
          {text}
        </p>
      ))}
      {shown.length > 0 && (
        <button
          type="button"
          onClick={() => {
            dismissed.value = shown.at(-1)?.number ?? 0;
          }}
        >
          {t("app.dismiss")}
        </button>
      )}
    </aside>
  );
}
