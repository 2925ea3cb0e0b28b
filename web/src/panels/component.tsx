/** Panels as components. */

import { signal } from "@preact/signals";
import { Component, type ComponentChildren, type ComponentType, render } from "preact";
import { t } from "../i18n/text";
import type { Act } from "../robot/permissions";
import type { PanelContext } from "./registry";

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

class Guard extends Component<{ children: ComponentChildren }, { error: Error | null }> {
  override state = { error: null as Error | null };

  override componentDidCatch(error: Error): void {
    this.setState({ error });
  }

  render() {
    if (!this.state.error) return this.props.children;
    return <Problem text={t("panel.failed", { reason: this.state.error.message })} />;
  }
}

/** Something that is wrong, said where it is. */
export function Problem({ text }: { text: string }) {
  return (
    <p class="problem" role="alert">
      {text}
    </p>
  );
}

/** Why a control is not there: the role does not allow what it does. */
export function Refusal({ context, act, name }: { context: PanelContext; act: Act; name: string }) {
  const role = context.session.permissions.value.role;
  return <p class="refusal">{t("role.refused", { role, act: t(`act.${act}`), name })}</p>;
}

/** A choice among topics, one of which may be gone by now. */
export function TopicChoice(props: {
  label: string;
  topics: readonly string[];
  chosen: string;
  onChoose: (topic: string) => void;
}) {
  const { label, topics, chosen, onChoose } = props;
  const all = chosen && !topics.includes(chosen) ? [chosen, ...topics] : topics;
  return (
    <label class="choice">
      <span>{label}</span>
      <select value={chosen} onChange={(event) => onChoose(event.currentTarget.value)}>
        {all.map((topic) => (
          <option key={topic} value={topic}>
            {topic}
          </option>
        ))}
      </select>
    </label>
  );
}

/** The time, told once a second to whoever shows ages. */
export const now = signal(Date.now());
setInterval(() => {
  now.value = Date.now();
}, 1000);
