/** One panel in its place: made, shown, hidden and ended, wherever it is docked. */

import { effect, type ReadonlySignal, signal } from "@preact/signals";
import { plain } from "../i18n/plain";
import { t } from "../i18n/text";
import { now } from "../panels/component";
import { panelKind } from "../panels/registry";
import type { App, OpenPanel } from "./state";

export interface PanelFrame {
  element: HTMLElement;
  setVisible(visible: boolean): void;
  dispose(): void;
}

/** Begin a panel in an element of its own. */
export function framePanel(app: App, panel: OpenPanel): PanelFrame {
  // The region around it has its name already: that of its tab.
  const element = document.createElement("div");
  element.className = `panel panel-${panel.kind}`;
  const kind = panelKind(panel.kind);
  const visible = signal(true);
  const config = signal(panel.config);
  app.configs.value = new Map(app.configs.peek()).set(panel.id, config);
  let first = true;
  const stopSaving = effect(() => {
    const value = config.value;
    if (!first) app.configure(panel.id, value);
    first = false;
  });
  // The page's style greys the panel out, and shows the attribute above it.
  const endAging = effect(() => {
    const { session } = app;
    const isStale = session.connections.value > 0 && !session.isAnswering;
    element.classList.toggle("stale", isStale);
    if (!isStale) element.removeAttribute("data-age");
    else {
      const age = Math.max(0, Math.round((now.value - session.answeredAt.value) / 1000));
      element.dataset.age = t("link.stale", { seconds: age });
    }
  });
  let ended = false;
  let end: (() => void) | undefined;
  const say = (words: string) => {
    const text = document.createElement("p");
    text.className = "problem";
    text.setAttribute("role", "alert");
    text.textContent = plain(words);
    element.replaceChildren(text);
  };
  const fail = (error: unknown) => {
    say(t("panel.failed", { reason: (error as Error).message }));
    console.error(error);
  };
  if (!kind) say(t("panel.unknown", { kind: panel.kind }));
  const isEmpty = app.recording !== null && kind?.needsRobot;
  if (isEmpty) say(t("blocked.recording"));
  try {
    const begun = (isEmpty ? undefined : kind)?.init({
      session: app.session,
      stop: app.stop,
      navigation: app.navigation,
      host: element,
      config,
      visible: visible as ReadonlySignal<boolean>,
      dark: app.dark,
      open: (name, settings) => app.open(name, settings),
      openRecording: (file) => app.openRecording(file),
    });
    Promise.resolve(begun).then((dispose) => {
      if (ended) dispose?.();
      else end = dispose;
    }, fail);
  } catch (error) {
    fail(error);
  }
  return {
    element,
    setVisible: (value) => {
      visible.value = value;
    },
    dispose: () => {
      ended = true;
      const others = new Map(app.configs.peek());
      if (others.get(panel.id) === config && others.delete(panel.id)) app.configs.value = others;
      stopSaving();
      endAging();
      end?.();
    },
  };
}
