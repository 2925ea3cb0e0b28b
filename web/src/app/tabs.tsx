/** Panels one at a time, for narrow screens. */

import { X } from "lucide";
import type { ComponentChild } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Icon } from "../forms/icon";
import { t } from "../i18n/text";
import { panelIcon } from "../panels/icons";
import { panelKind } from "../panels/registry";
import { framePanel } from "./panel_frame";
import type { App, OpenPanel } from "./state";

/** `stop` is at the thumb, whatever panel is shown. */
export function Tabs({ app, stop }: { app: App; stop: ComponentChild }) {
  const panels = app.panels.value;
  const front = panels.find(({ id }) => id === app.front.value) ?? panels[0];
  const asked = app.asked.value;
  useEffect(() => {
    const tab = asked && document.getElementById(`tab ${asked.id}`);
    tab?.focus();
    tab?.scrollIntoView({ block: "nearest", inline: "center" });
  }, [asked]);
  const step = (event: KeyboardEvent) => {
    if (!front) return;
    if (event.key === "Delete") {
      app.close(front.id);
      return;
    }
    const at = panels.indexOf(front);
    const wanted = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: -1 }[event.key];
    if (wanted === undefined) return;
    event.preventDefault();
    const next = panels.at(wanted % panels.length) as OpenPanel;
    app.front.value = next.id;
    document.getElementById(`tab ${next.id}`)?.focus();
  };
  return (
    <div class="tabs">
      <div class="tabs-content" role="tabpanel" aria-labelledby={`tab ${front?.id}`}>
        {front && <Framed key={`${app.replaced.value} ${front.id}`} app={app} panel={front} />}
      </div>
      <div class="tabs-foot">
        {stop}
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
              <Icon of={panelIcon(kind)} size={20} />
              {titleOf(kind)}
            </button>
          ))}
        </div>
        {front && (
          <button
            type="button"
            class="plain close"
            aria-label={t("panel.close", { name: titleOf(front.kind) })}
            onClick={() => app.close(front.id)}
          >
            <Icon of={X} />
          </button>
        )}
      </div>
    </div>
  );
}

function titleOf(kind: string): string {
  const known = panelKind(kind);
  return known ? t(known.title) : kind;
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
