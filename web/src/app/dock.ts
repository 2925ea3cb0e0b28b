/** Panels side by side and in tabs, as people drag them. */

import { effect, untracked } from "@preact/signals";
import { plain } from "../i18n/plain";
import "dockview-core/style.css";
import {
  createDockview,
  type DockviewApi,
  type DockviewGroupPanel,
  type IDockviewPanel,
  type IHeaderActionsRenderer,
  themeDark,
  themeLight,
} from "dockview-core";
import { Ellipsis, X } from "lucide";
import { iconElement } from "../forms/icon";
import { t } from "../i18n/text";
import { panelKind } from "../panels/registry";
import { framePanel } from "./panel_frame";
import type { App, OpenPanel } from "./state";

/** Dock the panels of the page in an element; returns what ends it. */
export function dockPanels(app: App, element: HTMLElement): () => void {
  const api = createDockview(element, {
    theme: app.dark.peek() ? themeDark : themeLight,
    disableFloatingGroups: true,
    // Tabs without a button in them: a control within a control cannot be reached by everybody.
    defaultTabComponent: "tab",
    createTabComponent: () => {
      const element = document.createElement("span");
      element.className = "tab-title";
      return {
        element,
        init: ({ title }) => {
          element.textContent = plain(title);
        },
      };
    },
    createRightHeaderActionComponent: () => headerActions(api),
    createComponent: ({ id }) => {
      const panel = app.panels.peek().find((each) => each.id === id) ?? { id, kind: id, config: {} };
      const frame = framePanel(app, panel);
      return {
        element: frame.element,
        init: ({ api: panelApi }) => {
          frame.setVisible(panelApi.isVisible);
          panelApi.onDidVisibilityChange(({ isVisible }) => frame.setVisible(isVisible));
        },
        dispose: frame.dispose,
      };
    },
  });
  let settling = false;
  const changes = [
    api.onDidLayoutChange(() => {
      if (!settling) app.dock.value = api.toJSON();
    }),
    api.onDidRemovePanel(({ id }) => {
      if (!settling) app.close(id);
    }),
  ];
  const settle = (change: () => void) => {
    settling = true;
    try {
      change();
    } finally {
      settling = false;
    }
  };
  const effects = [
    effect(() => {
      app.replaced.value;
      untracked(() => settle(() => restore(api, app)));
    }),
    effect(() => {
      const panels = app.panels.value;
      untracked(() =>
        settle(() => {
          const wanted = new Set(panels.map(({ id }) => id));
          for (const panel of api.panels) if (!wanted.has(panel.id)) api.removePanel(panel);
          for (const panel of panels) if (!api.getPanel(panel.id)) add(api, app, panel);
        }),
      );
    }),
    effect(() => {
      const front = app.front.value;
      untracked(() => api.getPanel(front)?.api.setActive());
    }),
    effect(() => {
      const asked = app.asked.value;
      untracked(() => {
        const panel = asked && api.getPanel(asked.id);
        if (!panel) return;
        panel.api.setActive();
        focusTab(panel);
      });
    }),
    effect(() => api.updateOptions({ theme: app.dark.value ? themeDark : themeLight })),
  ];
  return () => {
    settling = true;
    for (const end of effects) end();
    for (const change of changes) change.dispose();
    api.dispose();
  };
}

/** Buttons in the head of a group: one that arranges it without a mouse, and one that closes the panel in it. */
function headerActions(api: DockviewApi): IHeaderActionsRenderer {
  const element = document.createElement("div");
  element.className = "group-actions";
  const [arrange, close] = [textButton(""), textButton("")];
  arrange.append(iconElement(Ellipsis));
  close.append(iconElement(X));
  arrange.className = close.className = "plain close";
  const menu = document.createElement("div");
  menu.className = "menu arrange";
  menu.popover = "auto";
  arrange.popoverTargetElement = menu;
  element.append(arrange, close, menu);
  let ends: { dispose(): void }[] = [];
  return {
    element,
    init: ({ group }) => {
      const tell = () => {
        const name = group.activePanel?.title ?? "";
        arrange.setAttribute("aria-label", t("panel.arrange", { name }));
        close.setAttribute("aria-label", t("panel.close", { name }));
      };
      close.onclick = () => group.activePanel?.api.close();
      menu.onbeforetoggle = ({ newState }) => {
        if (newState !== "open" || !group.activePanel) return;
        menu.replaceChildren(...arrangements(api, group.activePanel, menu));
        const { right, bottom } = arrange.getBoundingClientRect();
        menu.style.setProperty("right", `${innerWidth - right}px`);
        menu.style.setProperty("top", `${bottom}px`);
      };
      menu.ontoggle = ({ newState }) => {
        if (newState === "open") menu.querySelector("button")?.focus();
      };
      // The browser folds it; the key that stops the robot is not meant.
      menu.onkeydown = (event) => {
        if (event.key === "Escape") event.stopPropagation();
      };
      ends = [group.api.onDidActivePanelChange(tell)];
      tell();
    },
    dispose: () => {
      for (const end of ends) end.dispose();
    },
  };
}

function textButton(text: string): HTMLButtonElement {
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = text;
  return button;
}

/** Directions as texts have them, and what Dockview calls them of groups that lie there and of places within one. */
const DIRECTIONS = [
  { direction: "left", where: "left", position: "left" },
  { direction: "right", where: "right", position: "right" },
  { direction: "above", where: "up", position: "top" },
  { direction: "below", where: "down", position: "bottom" },
] as const;
/** Share of a group's size by which it grows or shrinks at a time. */
const GROWTH = 0.15;

/** Buttons that act on the place of a panel. */
function arrangements(api: DockviewApi, panel: IDockviewPanel, menu: HTMLElement): HTMLElement[] {
  const { group } = panel;
  const act = (text: string, change: () => void, stays = false) => {
    const button = textButton(text);
    button.onclick = () => {
      if (!stays) menu.hidePopover();
      change();
      if (!stays) focusTab(panel);
    };
    return button;
  };
  const isMaximized = panel.api.isMaximized();
  const all = [
    act(t(isMaximized ? "panel.restore" : "panel.maximize"), () =>
      isMaximized ? panel.api.exitMaximized() : panel.api.maximize(),
    ),
  ];
  if (isMaximized) return all;
  for (const { direction, where, position } of DIRECTIONS) {
    const neighbour = api.adjacentGroupInDirection(group, where) as DockviewGroupPanel | undefined;
    if (neighbour) all.push(act(t(`panel.move.${direction}`), () => panel.api.moveTo({ group: neighbour })));
    if (group.panels.length > 1)
      all.push(act(t(`panel.split.${direction}`), () => panel.api.moveTo({ group, position })));
  }
  if (api.groups.length < 2) return all;
  const grow = (side: "width" | "height", by: number) => () =>
    panel.api.setSize({ [side]: Math.round(panel.group.api[side] * by) });
  return [
    ...all,
    act(t("panel.wider"), grow("width", 1 + GROWTH), true),
    act(t("panel.narrower"), grow("width", 1 - GROWTH), true),
    act(t("panel.taller"), grow("height", 1 + GROWTH), true),
    act(t("panel.shorter"), grow("height", 1 - GROWTH), true),
  ];
}

/** Give the keyboard to the tab of a panel. */
function focusTab(panel: IDockviewPanel): void {
  panel.group.element.querySelector<HTMLElement>('[role="tab"][aria-selected="true"]')?.focus();
}

function restore(api: DockviewApi, app: App): void {
  api.clear();
  if (app.dock.peek()) {
    try {
      api.fromJSON(app.dock.peek() as Parameters<DockviewApi["fromJSON"]>[0]);
      return;
    } catch (error) {
      api.clear();
      app.session.note("warning", t("layout.bad", { reason: (error as Error).message }));
    }
  }
  for (const panel of app.panels.peek()) add(api, app, panel);
  for (const place of ["main", "right", "controls", "below"]) {
    const first = app.panels.peek().find((panel) => panelKind(panel.kind)?.place === place);
    if (first) api.getPanel(first.id)?.api.setActive();
  }
}

/** Shares of the width and height that a place begins with. */
const SHARES = { right: 0.33, controls: 0.5, below: 0.36 };

function add(api: DockviewApi, app: App, panel: OpenPanel): void {
  const kind = panelKind(panel.kind);
  const place = kind?.place ?? "main";
  const placed = (where: string) =>
    api.panels.find(
      ({ id }) => panelKind(app.panels.peek().find((each) => each.id === id)?.kind ?? "")?.place === where,
    );
  const beside = placed(place);
  const options = { id: panel.id, component: panel.kind, title: kind ? t(kind.title) : panel.kind };
  if (beside) {
    api.addPanel({
      ...options,
      position: { referencePanel: beside.id, direction: "within" },
      inactive: true,
    });
  } else if (place === "controls" && placed("right")) {
    const position = { referencePanel: placed("right")?.id as string, direction: "below" } as const;
    api.addPanel({ ...options, position, initialHeight: api.height * SHARES.controls });
  } else if ((place === "right" || place === "controls") && api.panels.length) {
    api.addPanel({ ...options, position: { direction: "right" }, initialWidth: api.width * SHARES.right });
  } else if (place === "below" && api.panels.length) {
    const above = placed("main") ?? (api.panels[0] as { id: string });
    const position = { referencePanel: above.id, direction: "below" } as const;
    api.addPanel({ ...options, position, initialHeight: api.height * SHARES.below });
  } else {
    api.addPanel(options);
  }
}
