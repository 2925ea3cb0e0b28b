/** A text field that offers what fits, however many possibilities there are. */

import { useSignal } from "@preact/signals";
import { useEffect, useId, useRef } from "preact/hooks";
import { t } from "../i18n/text";

/** Rows that are offered at a time. */
const MOST_ROWS = 50;

/** Options with every word of a text, those that begin with it first. */
export function fitting(options: readonly string[], text: string): string[] {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  const found = options.filter((option) => words.every((word) => option.toLowerCase().includes(word)));
  const begins = (option: string) => option.toLowerCase().startsWith(words[0] ?? "");
  return words.length ? [...found.filter(begins), ...found.filter((option) => !begins(option))] : found;
}

export function Suggest(props: {
  label: string;
  value: string;
  options: readonly string[];
  placeholder?: string;
  disabled?: boolean;
  onInput: (value: string) => void;
}) {
  const { label, value, options, placeholder = label, disabled = false, onInput } = props;
  const id = useId();
  const open = useSignal(false);
  const active = useSignal(-1);
  const input = useRef<HTMLInputElement>(null);
  const list = useRef<HTMLDivElement>(null);
  const found = open.value ? fitting(options, options.includes(value) ? "" : value) : [];
  const rows = found.slice(0, MOST_ROWS);
  const isShown = rows.length > 0;
  // In the top layer: the panel around the field would cut the list off.
  useEffect(() => {
    const { current } = list;
    if (!isShown || !current || !input.current) return undefined;
    const { left, top, bottom, width } = input.current.getBoundingClientRect();
    const below = innerHeight - bottom;
    const isAbove = below < 200 && top > below;
    current.style.left = `${left}px`;
    current.style.minWidth = `${width}px`;
    current.style.top = isAbove ? "auto" : `${bottom + 2}px`;
    current.style.bottom = isAbove ? `${innerHeight - top + 2}px` : "auto";
    current.showPopover();
    return () => current.hidePopover();
  }, [isShown]);
  const choose = (option: string) => {
    onInput(option);
    open.value = false;
    active.value = -1;
    input.current?.focus();
  };
  const key = (event: KeyboardEvent) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step) {
      event.preventDefault();
      open.value = true;
      active.value = Math.max(-1, Math.min(rows.length - 1, active.value + step));
      document.getElementById(`${id}-${active.value}`)?.scrollIntoView({ block: "nearest" });
    } else if (event.key === "Enter" && open.value && rows[active.value] !== undefined) {
      event.preventDefault();
      choose(rows[active.value] as string);
    } else if (event.key === "Escape") open.value = false;
  };
  return (
    <label class="suggest">
      <span class="hidden">{label}</span>
      <input
        ref={input}
        type="text"
        role="combobox"
        autocomplete="off"
        spellcheck={false}
        placeholder={placeholder}
        disabled={disabled}
        aria-expanded={isShown}
        aria-controls={`${id}-list`}
        aria-autocomplete="list"
        aria-activedescendant={open.value && active.value >= 0 ? `${id}-${active.value}` : undefined}
        value={value}
        onFocus={() => {
          open.value = true;
        }}
        onBlur={() => {
          open.value = false;
        }}
        onKeyDown={key}
        onInput={(event) => {
          open.value = true;
          active.value = -1;
          onInput(event.currentTarget.value);
        }}
      />
      <div class="suggest-list" popover="manual" ref={list}>
        <div id={`${id}-list`} role="listbox" aria-label={label}>
          {rows.map((option, at) => (
            // biome-ignore lint/a11y/useKeyWithClickEvents: the keyboard stays in the field, which points at options.
            // biome-ignore lint/a11y/useFocusableInteractive: for the same reason.
            <div
              key={option}
              id={`${id}-${at}`}
              role="option"
              aria-selected={at === active.value}
              onPointerDown={(event) => event.preventDefault()}
              onClick={() => choose(option)}
            >
              {option}
            </div>
          ))}
        </div>
        {found.length > rows.length && (
          <p class="faint">{t("topics.more", { count: found.length - rows.length })}</p>
        )}
      </div>
    </label>
  );
}
