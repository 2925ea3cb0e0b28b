/** Panels one at a time, for narrow screens. */

import { useEffect, useRef } from "preact/hooks";
import { t } from "../i18n/text";
import { panelKind } from "../panels/registry";
import { framePanel } from "./panel_frame";
import type { App, OpenPanel } from "./state";

export function Tabs({ app }: { app: App }) {
  const panels = app.panels.value;
  const front = panels.find(({ id }) => id === app.front.value) ?? panels[0];
  const step = (event: KeyboardEvent) => {
    const direction = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!direction || !front) return;
    const next = panels[(panels.indexOf(front) + direction + panels.length) % panels.length] as OpenPanel;
    app.front.value = next.id;
    document.getElementById(`tab ${next.id}`)?.focus();
  };
  return (
    <div class="tabs">
      <div class="tabs-content" role="tabpanel" aria-labelledby={`tab ${front?.id}`}>
        {front && <Framed key={`${app.replaced.value} ${front.id}`} app={app} panel={front} />}
      </div>
      <div class="tabs-bar" role="tablist" aria-label={t("app.panels")} onKeyDown={step}>
        {panels.map(({ id, kind }) => (
          <button
            type="button"
            key={id}
            id={`tab ${id}`}
            role="tab"
            aria-selected={id === front?.id}
            tabIndex={id === front?.id ? 0 : -1}
            onClick={() => {
              app.front.value = id;
            }}
          >
            {t(panelKind(kind)?.title ?? "panel.nothing")}
          </button>
        ))}
      </div>
    </div>
  );
}

function Framed({ app, panel }: { app: App; panel: OpenPanel }) {
  const place = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const frame = framePanel(app, panel);
    place.current?.append(frame.element);
    return () => {
      frame.dispose();
      frame.element.remove();
    };
  }, []);
  return <div class="tabs-frame" ref={place} />;
}
