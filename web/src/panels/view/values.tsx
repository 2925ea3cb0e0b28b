/** Fields of messages as gauges, and as bars of the states that they were in. */

import { useSignal } from "@preact/signals";
import { X } from "lucide";
import { useRef } from "preact/hooks";
import { Icon } from "../../forms/icon";
import { t } from "../../i18n/text";
import { leafPaths, valueAt } from "../../robot/fields";
import type { Message } from "../../robot/subscriptions";
import { componentPanel, now, useMessages } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { AddField, type Field } from "./add_field";

/** Milliseconds of states that are shown, and between two messages. */
const SPAN = 60_000;
const THROTTLE = 100;
/** States that are kept, colours that tell them apart, and characters of each. */
const MOST_STATES = 500;
const COLOURS = 6;
const MOST_TEXT = 80;
/** Radius of a gauge, and the length of its half circle. */
const RADIUS = 40;
const ARC = Math.PI * RADIUS;

export const values: PanelKind = {
  name: "values",
  title: "values.title",
  supportedTypes: [],
  opens: () => false,
  place: "below",
  init: componentPanel(ValuesPanel),
};

function ValuesPanel({ context }: { context: PanelContext }) {
  const { config } = context;
  const fields = (config.value.fields as Field[] | undefined) ?? [];
  const set = (next: Field[]) => {
    config.value = { ...config.value, fields: next };
  };
  return (
    <div class="values">
      <AddField context={context} pathsOf={leafPaths} onAdd={(field) => set([...fields, field])} />
      {!fields.length && <p class="blank">{t("values.choose")}</p>}
      <div class="values-list">
        {fields.map((field, at) => (
          <Value
            key={`${field.topic} ${field.path}`}
            context={context}
            field={field}
            onRemove={() => set(fields.filter((_, other) => other !== at))}
          />
        ))}
      </div>
    </div>
  );
}

interface State {
  at: number;
  text: string;
}

function Value(props: { context: PanelContext; field: Field; onRemove: () => void }) {
  const { context, field, onRemove } = props;
  const { session, visible } = context;
  const { topic, path } = field;
  const value = useSignal<unknown>(undefined);
  const states = useRef<State[]>([]);
  const range = useRef({ least: 0, most: 0 });
  const take = (message: Message) => {
    const next = valueAt(message, path);
    if (typeof next === "number" && Number.isFinite(next)) {
      range.current.least = Math.min(range.current.least, next);
      range.current.most = Math.max(range.current.most, next);
    } else {
      const text = String(next).slice(0, MOST_TEXT);
      if (states.current.at(-1)?.text !== text) states.current.push({ at: Date.now(), text });
      if (states.current.length > MOST_STATES) states.current.shift();
    }
    value.value = next;
  };
  useMessages(session, topic, take, { throttle: THROTTLE, isOn: visible.value });
  const name = `${topic} ${path}`;
  return (
    <section class="value">
      <h2 title={name}>
        {topic} <small>{path}</small>
      </h2>
      <button type="button" class="close" aria-label={t("form.remove", { name })} onClick={onRemove}>
        <Icon of={X} size={14} />
      </button>
      {value.value === undefined ? (
        <p class="faint waiting">{t("panel.waiting", { name: topic })}</p>
      ) : typeof value.value === "number" ? (
        <Gauge value={value.value} {...range.current} name={name} />
      ) : (
        <States states={states.current} />
      )}
    </section>
  );
}

/** A number on a half circle from the least to the most that it was. */
function Gauge({ value, least, most, name }: { value: number; least: number; most: number; name: string }) {
  const share = most > least ? Math.max(0, Math.min(1, (value - least) / (most - least))) : 0;
  const arc = `M ${50 - RADIUS} 50 A ${RADIUS} ${RADIUS} 0 0 1 ${50 + RADIUS} 50`;
  const short = (number: number) => String(Number(number.toPrecision(4))).replace("-", "−");
  return (
    <div class="gauge">
      <svg viewBox="0 0 100 56" role="img" aria-label={`${name}: ${short(value)}`}>
        <path d={arc} />
        <path d={arc} class="gauge-value" stroke-dasharray={`${share * ARC} ${ARC}`} />
      </svg>
      <b>{short(value)}</b>
      <small>
        {short(least)} … {short(most)}
      </small>
    </div>
  );
}

/** The states of the last minute as a bar, the present one in words. */
function States({ states }: { states: readonly State[] }) {
  const end = now.value;
  const begin = end - SPAN;
  const parts = states
    .map(({ at, text }, index) => ({ text, from: Math.max(at, begin), to: states[index + 1]?.at ?? end }))
    .filter(({ from, to }) => to > from);
  // Where a state stands among those that there were: the same one keeps its colour.
  const known = [...new Set(states.map(({ text }) => text))];
  const x = (at: number) => ((at - begin) / SPAN) * 100;
  return (
    <div class="states">
      <b>{states.at(-1)?.text}</b>
      <svg viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true">
        {parts.map(({ text, from, to }) => (
          <rect
            key={from}
            class={`state-colour-${known.indexOf(text) % COLOURS}`}
            x={x(from)}
            width={x(to) - x(from)}
            height={10}
          >
            <title>{text}</title>
          </rect>
        ))}
      </svg>
      <small>{t("values.states", { count: Math.max(0, states.length - 1), seconds: SPAN / 1000 })}</small>
    </div>
  );
}
