/**
 * Scanning, for people who use one switch: what can be done lights up in turn, and the switch (the space bar or
 * Enter) does it. What must be held acts while the switch is held. A group lights up as one, and the switch goes into
 * it; when nothing of it was chosen for a while, the rest of the page has its turn again.
 */

import { useSignal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import { Choice } from "../forms/inputs";
import { t } from "../i18n/text";
import type { App } from "./state";

/** Seconds for which each choice is lit. */
const PACES = [0.8, 1.2, 2, 3];

/** Rounds through a group before it is left. */
const ROUNDS = 2;

/** Choices in the order of the page: all of a group and the stop, or else groups and controls without one. */
function choices(group: Element | null): HTMLElement[] {
  const all = [...document.querySelectorAll<HTMLElement>("[data-scan]")].filter(
    (element) => !element.matches(":disabled") && element.checkVisibility(),
  );
  if (group) return all.filter((element) => group.contains(element) || element.matches(".stop, .release"));
  return [...new Set(all.map((element) => element.closest<HTMLElement>("[data-scan-group]") ?? element))];
}

/** Label of a choice. */
function nameOf(element: HTMLElement): string {
  const said = element.getAttribute("aria-label");
  if (said !== null) return said;
  const isField = element instanceof HTMLInputElement || element instanceof HTMLSelectElement;
  if (!isField) return textOf(element);
  const label = element.labels?.[0]?.firstChild?.textContent ?? "";
  return element.type === "checkbox" ? textOf(element.labels?.[0] ?? element) : `${label} ${element.value}`;
}

/** The text of an element without the signs in it. */
function textOf(element: HTMLElement): string {
  const copy = element.cloneNode(true) as HTMLElement;
  for (const sign of copy.querySelectorAll('[aria-hidden="true"]')) sign.remove();
  return (copy.textContent ?? "").trim();
}

/** Take the value after the one that is chosen, of a choice or of what a field suggests. */
function takeNext(element: HTMLElement): void {
  if (element instanceof HTMLSelectElement) {
    element.selectedIndex = (element.selectedIndex + 1) % element.options.length;
    element.dispatchEvent(new Event("change", { bubbles: true }));
  } else if (element instanceof HTMLInputElement) {
    const values = [...(element.list?.options ?? [])].map(({ value }) => value);
    element.value = values[(values.indexOf(element.value) + 1) % values.length] ?? element.value;
    element.dispatchEvent(new Event("input", { bubbles: true }));
  }
}

export function ScanBar({ app }: { app: App }) {
  const pace = useSignal(1.2);
  const lit = useSignal("");
  const current = useRef<HTMLElement | null>(null);
  const held = useRef<HTMLElement | null>(null);
  const group = useRef<{ element: HTMLElement; left: number } | null>(null);
  const seconds = pace.value;
  useLayoutEffect(() => {
    const light = (element: HTMLElement | null) => {
      current.current?.classList.remove("scanned");
      current.current = element;
      element?.classList.add("scanned");
      lit.value = element ? nameOf(element) : "";
    };
    const goOn = () => {
      if (held.current) return;
      const { current: inside } = group;
      // What has gone, as with its panel, is left.
      if (inside && (inside.left-- <= 0 || !inside.element.isConnected)) group.current = null;
      const all = choices(group.current?.element ?? null);
      const last = inside && !group.current ? inside.element : current.current;
      const at = last ? all.indexOf(last) : -1;
      light(all[(at + 1) % all.length] ?? null);
    };
    const timer = setInterval(goOn, seconds * 1000);
    const stayIn = (element: HTMLElement) => {
      group.current = { element, left: ROUNDS * choices(element).length };
    };
    const press = (element: HTMLElement) => {
      if (element.matches("[data-scan-group]")) {
        stayIn(element);
        light(choices(element).find((each) => element.contains(each)) ?? null);
        return;
      }
      if (group.current) stayIn(group.current.element);
      held.current = element;
      element.focus();
      if (element.dataset.scan === "hold") key(element, "keydown");
      else if (element.dataset.scan === "next") takeNext(element);
      else element.click();
      lit.value = nameOf(element);
    };
    const release = () => {
      const element = held.current;
      held.current = null;
      if (element?.dataset.scan === "hold") key(element, "keyup");
    };
    const isSwitch = (event: KeyboardEvent) =>
      event.isTrusted && (event.key === " " || event.key === "Enter");
    const down = (event: KeyboardEvent) => {
      if (!isSwitch(event)) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      if (!event.repeat && current.current) press(current.current);
    };
    const up = (event: KeyboardEvent) => {
      if (!isSwitch(event)) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      release();
    };
    addEventListener("keydown", down, { capture: true });
    addEventListener("keyup", up, { capture: true });
    addEventListener("blur", release);
    return () => {
      clearInterval(timer);
      light(null);
      release();
      removeEventListener("keydown", down, { capture: true });
      removeEventListener("keyup", up, { capture: true });
      removeEventListener("blur", release);
    };
  }, [seconds, lit]);
  return (
    <div class="scan-bar">
      <span aria-live="assertive">{t("scan.lit", { name: lit.value })}</span>
      <fieldset class="scan-panels" data-scan-group aria-label={t("app.panels")}>
        {(["teleop", "goal"] as const).map((kind) => (
          <button key={kind} type="button" data-scan="press" onClick={() => app.open(kind)}>
            {t(`${kind}.title`)}
          </button>
        ))}
        <Choice
          label={t("scan.pace")}
          scan
          chosen={String(seconds)}
          options={PACES.map((each) => [String(each), `${each} s`])}
          onChoose={(value) => {
            pace.value = Number(value);
          }}
        />
      </fieldset>
    </div>
  );
}

function key(element: HTMLElement, type: "keydown" | "keyup"): void {
  element.dispatchEvent(new KeyboardEvent(type, { key: " ", bubbles: true, cancelable: true }));
}
