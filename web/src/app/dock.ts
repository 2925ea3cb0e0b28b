/** Panels side by side and in tabs, as people drag them. */

import { effect, untracked } from "@preact/signals";
import "dockview-core/style.css";
import {
  createDockview,
  type DockviewApi,
  type IHeaderActionsRenderer,
  themeDark,
  themeLight,
} from "dockview-core";
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
          element.textContent = title;
        },
      };
    },
    createRightHeaderActionComponent: () => closeButton(),
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
    effect(() => api.updateOptions({ theme: app.dark.value ? themeDark : themeLight })),
  ];
  return () => {
    settling = true;
    for (const end of effects) end();
    for (const change of changes) change.dispose();
    api.dispose();
  };
}

/** A button in the head of a group that closes the panel that is shown in it. */
function closeButton(): IHeaderActionsRenderer {
  const element = document.createElement("button");
  element.type = "button";
  element.className = "plain close";
  element.textContent = "×";
  let ends: { dispose(): void }[] = [];
  return {
    element,
    init: ({ group }) => {
      const name = () =>
        element.setAttribute("aria-label", t("panel.close", { name: group.activePanel?.title ?? "" }));
      element.onclick = () => group.activePanel?.api.close();
      ends = [group.api.onDidActivePanelChange(name)];
      name();
    },
    dispose: () => {
      for (const end of ends) end.dispose();
    },
  };
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
