/** A button that unfolds a menu; Escape, a click elsewhere and leaving it by the keyboard fold it again. */

import { useSignal } from "@preact/signals";
import type { IconNode } from "lucide";
import type { ComponentChild } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Icon } from "./icon";

/** With an icon, that is shown, and the label is its tooltip. */
export function Menu(props: {
  label: string;
  icon?: IconNode;
  children: (close: () => void) => ComponentChild;
}) {
  const { label, icon, children } = props;
  const details = useRef<HTMLDetailsElement>(null);
  const open = useSignal(false);
  const close = () => {
    const { current } = details;
    if (!current?.open) return;
    // The keyboard stays at the menu when what had it goes.
    if (current.contains(document.activeElement)) current.querySelector("summary")?.focus();
    current.open = false;
  };
  useEffect(() => {
    const outside = (event: Event) => {
      if (!details.current?.contains(event.target as Node)) close();
    };
    const fold = ({ key }: KeyboardEvent) => {
      if (key === "Escape") close();
    };
    addEventListener("pointerdown", outside);
    // Wherever the keyboard is.
    addEventListener("keydown", fold);
    return () => {
      removeEventListener("pointerdown", outside);
      removeEventListener("keydown", fold);
    };
  });
  return (
    <details
      class={icon ? "dropdown with-icon" : "dropdown"}
      ref={details}
      onToggle={() => {
        open.value = details.current?.open ?? false;
      }}
      onFocusOut={({ relatedTarget }) => {
        const next = relatedTarget as Node | null;
        const { current } = details;
        // A press on a label gives the focus to what is around the menu at first: that does not leave it.
        if (next && current && !current.contains(next) && !next.contains(current)) current.open = false;
      }}
    >
      {/* biome-ignore lint/a11y/noStaticElementInteractions: a summary is a control of its own: it has the focus, and Enter and the space bar click it. */}
      <summary
        onClick={() => {
          // At once: the next key may be on its way into the menu.
          open.value = !details.current?.open;
        }}
      >
        {icon && <Icon of={icon} />}
        <span class={icon ? "words" : ""}>{label}</span>
      </summary>
      <div class="menu">{open.value && children(close)}</div>
    </details>
  );
}
