/** Panels as components. */

import { signal, useSignal } from "@preact/signals";
import { type ComponentType, render } from "preact";
import { useEffect, useRef } from "preact/hooks";

import { Choice } from "../forms/inputs";
import { useLater } from "../forms/later";
import { Guard, Problem } from "../forms/problem";
import { t } from "../i18n/text";
import type { Act } from "../robot/permissions";
import type { RobotSession } from "../robot/session";
import type { Message } from "../robot/subscriptions";
import type { PanelContext, PanelKind } from "./registry";

/** The `init` of a panel that is one component. A fault in it is said on the panel. */
export function componentPanel(View: ComponentType<{ context: PanelContext }>) {
  return (context: PanelContext) => {
    render(
      <Guard>
        <View context={context} />
      </Guard>,
      context.host,
    );
    return () => render(null, context.host);
  };
}

/** The component of a panel, as a module has it. */
interface PanelModule {
  Panel: ComponentType<{ context: PanelContext }>;
}

/** The `init` of a panel whose component is loaded when it opens. */
export function laterPanel(load: () => Promise<PanelModule>) {
  return componentPanel(function Later({ context }) {
    const loaded = useSignal<PanelModule | null>(null);
    const problem = useLater(
      load,
      (part) => {
        loaded.value = part;
        return undefined;
      },
      [],
    );
    if (loaded.value) return <loaded.value.Panel context={context} />;
    return problem ? <Problem text={problem} /> : <p class="faint">{t("app.loading")}</p>;
  });
}

/** Why a control is not there: the role does not allow what it does. */
export function Refusal({ context, act, name }: { context: PanelContext; act: Act; name: string }) {
  const role = context.session.permissions.value.role;
  return <p class="refusal">{t("role.refused", { role, act: t(`act.${act}`), name })}</p>;
}

/** What a panel is missing. */
export function Needs({ kind }: { kind: Pick<PanelKind, "supportedTypes"> }) {
  return <p class="blank">{t("panel.needs", { types: kind.supportedTypes.join(", ") })}</p>;
}

/**
 * Hear topics, those that the robot has and the role may hear, while `isOn`; returns true if there are any. A robot that
 * does not say what it offers may have them all.
 */
export function useMessages(
  session: RobotSession,
  topics: string | readonly string[],
  take: (message: Message, topic: string) => void,
  { throttle = 0, isOn = true } = {},
): boolean {
  const { topics: there, problem } = session.graph.value;
  const heard = [topics]
    .flat()
    .filter((topic) => isOn && topic && (there.has(topic) || problem) && session.may("subscribe", topic));
  const typed = JSON.stringify(heard.map((topic) => [topic, there.get(topic) ?? ""]));
  const latest = useRef(take);
  latest.current = take;
  useEffect(() => {
    const ends = (JSON.parse(typed) as [string, string][]).map(([topic, type]) =>
      session.subscribe(topic, type, (message) => latest.current(message, topic), { throttle }),
    );
    return () => {
      for (const end of ends) end();
    };
  }, [session, typed, throttle]);
  return heard.length > 0;
}

/** A choice among topics, which the panel's settings keep; the chosen one may be gone by now. */
export function TopicChoice(props: {
  context: PanelContext;
  topics: readonly string[];
  chosen: string;
  scan?: boolean;
}) {
  const { topics, chosen, scan = false } = props;
  const { config } = props.context;
  const all = chosen && !topics.includes(chosen) ? [chosen, ...topics] : topics;
  const choose = (topic: string) => {
    config.value = { ...config.value, topic };
  };
  return <Choice label={t("panel.topic")} scan={scan} chosen={chosen} options={all} onChoose={choose} />;
}

/** Have the browser save a file. */
export function saveAs(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

/** The time, updated once a second for displays of ages. */
export const now = signal(Date.now());
setInterval(() => {
  now.value = Date.now();
}, 1000);
