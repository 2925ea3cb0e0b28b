/**
 * Scanning, for people who use one switch: what can be done lights up in turn, and the switch (the space bar or
 * Enter) does it. What must be held acts while the switch is held.
 */

import { useSignal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import { Choice } from "../forms/inputs";
import { t } from "../i18n/text";
import type { App } from "./state";

/** Seconds for which each choice is lit. */
const PACES = [0.8, 1.2, 2, 3];

/** What can be chosen now, in the order of the page. */
function choices(): HTMLElement[] {
  return [...document.querySelectorAll<HTMLElement>("[data-scan]")].filter(
    (element) => !element.matches(":disabled") && element.offsetParent !== null,
  );
}

export function ScanBar({ app }: { app: App }) {
  const pace = useSignal(1.2);
  const lit = useSignal("");
  const current = useRef<HTMLElement | null>(null);
  const held = useRef<HTMLElement | null>(null);
  const seconds = pace.value;
  useLayoutEffect(() => {
    const light = (element: HTMLElement | null) => {
      current.current?.classList.remove("scanned");
      current.current = element;
      element?.classList.add("scanned");
      lit.value = element?.getAttribute("aria-label") ?? element?.textContent ?? "";
    };
    const timer = setInterval(() => {
      if (held.current) return;
      const all = choices();
      const at = current.current ? all.indexOf(current.current) : -1;
      light(all[(at + 1) % all.length] ?? null);
    }, seconds * 1000);
    const press = (element: HTMLElement) => {
      held.current = element;
      element.focus();
      if (element.dataset.scan === "hold") key(element, "keydown");
      else element.click();
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
      {(["teleop", "goal"] as const).map((kind) => (
        <button key={kind} type="button" data-scan="press" onClick={() => app.open(kind)}>
          {t(`${kind}.title`)}
        </button>
      ))}
      <Choice
        label={t("scan.pace")}
        chosen={String(seconds)}
        options={PACES.map((each) => [String(each), `${each} s`])}
        onChoose={(value) => {
          pace.value = Number(value);
        }}
      />
    </div>
  );
}

function key(element: HTMLElement, type: "keydown" | "keyup"): void {
  element.dispatchEvent(new KeyboardEvent(type, { key: " ", bubbles: true, cancelable: true }));
}
