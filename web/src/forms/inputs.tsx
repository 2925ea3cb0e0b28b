/** Inputs that several panels have: a choice, a search, a check box, a name to choose. */

import type { Signal } from "@preact/signals";
import type { ComponentChildren, InputHTMLAttributes } from "preact";
import { useId } from "preact/hooks";
import { t } from "../i18n/text";

/** A choice among values; each option is a value, or a value and what is shown of it. */
export function Choice(props: {
  label: ComponentChildren;
  /** True if one switch can go through the values. */
  scan?: boolean;
  /** True if the label is only for screen readers. */
  quiet?: boolean;
  chosen: string;
  options: readonly (string | readonly [value: string, shown: string])[];
  onChoose: (value: string) => void;
}) {
  const { label, scan, quiet = false, chosen, options, onChoose } = props;
  return (
    <label class="choice">
      <span class={quiet ? "hidden" : ""}>{label}</span>
      <select
        data-scan={scan ? "next" : undefined}
        value={chosen}
        onChange={(event) => onChoose(event.currentTarget.value)}
      >
        {options.map((option) => {
          const [value, shown] = typeof option === "string" ? [option, option] : option;
          return (
            <option key={value} value={value}>
              {shown}
            </option>
          );
        })}
      </select>
    </label>
  );
}

/** A field for a text, and its label before it; further attributes are those of the input. */
export function TextField(
  props: { label: string; text: Signal<string>; inline?: boolean } & InputHTMLAttributes<HTMLInputElement>,
) {
  const { label, text, inline, ...input } = props;
  return (
    <label class={inline ? "choice" : ""}>
      <span>{label}</span>
      <input
        type="text"
        {...input}
        value={text.value}
        onInput={(event) => {
          text.value = event.currentTarget.value;
        }}
      />
    </label>
  );
}

/** A field for what is searched. */
export function Search({ text, name = t("topics.search") }: { text: Signal<string>; name?: string }) {
  return (
    <label class="search">
      <span class="hidden">{name}</span>
      <input
        type="search"
        placeholder={name}
        value={text.value}
        onInput={(event) => {
          text.value = event.currentTarget.value;
        }}
      />
    </label>
  );
}

/** A box with a tick, and what it is about. */
export function Check(props: {
  checked: boolean;
  name?: string;
  disabled?: boolean;
  /** True if one switch can tick it. */
  scan?: boolean;
  onChange: (checked: boolean) => void;
  children: ComponentChildren;
}) {
  const { checked, name, disabled, scan, onChange, children } = props;
  return (
    <label class="check">
      <input
        type="checkbox"
        data-scan={scan ? "press" : undefined}
        name={name}
        checked={checked}
        disabled={disabled}
        onChange={(event) => onChange(event.currentTarget.checked)}
      />
      {children}
    </label>
  );
}

/** A number within limits: a slider between two buttons, and what is shown of the number. */
export function Slider(props: {
  label: string;
  value: number;
  least: number;
  most: number;
  /** The slider's step, and that of the buttons. */
  step: number;
  by: number;
  shown: string;
  onChange: (value: number) => void;
}) {
  const { label, value, least, most, step, by, shown, onChange } = props;
  const id = useId();
  const button = (sign: string, change: number, key: "teleop.less" | "teleop.more") => (
    <button
      type="button"
      data-scan="press"
      aria-label={t(key, { name: label })}
      onClick={() => onChange(value + change)}
    >
      {sign}
    </button>
  );
  return (
    <div class="limit">
      <label for={id}>{label}</label>
      {button("−", -by, "teleop.less")}
      <input
        id={id}
        type="range"
        min={least}
        max={most}
        step={step}
        value={value}
        aria-valuetext={shown}
        onInput={(event) => onChange(Number(event.currentTarget.value))}
      />
      {button("+", by, "teleop.more")}
      <span class="number">{shown}</span>
    </div>
  );
}

/** A name that can be chosen from a list. */
export function NameButton({
  name,
  title = name,
  chosen,
  onChoose,
}: {
  name: string;
  /** Full text, shown on hover. */
  title?: string;
  chosen?: boolean;
  onChoose: () => void;
}) {
  return (
    <button type="button" class="plain name" title={title} aria-pressed={chosen} onClick={onChoose}>
      {name}
    </button>
  );
}
