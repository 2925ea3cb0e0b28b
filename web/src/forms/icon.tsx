/** Icons of the page, from Lucide. */

import type { IconNode } from "lucide";
import { h, render } from "preact";

/** An icon beside a text, or in a control that has a name. */
export function Icon({ of, size = 18 }: { of: IconNode; size?: number }) {
  return (
    <svg class="icon" width={size} height={size} viewBox="0 0 24 24" aria-hidden="true">
      {of.map(([tag, attributes]) => h(tag, attributes))}
    </svg>
  );
}

/** The same as an element, for what is drawn without components. */
export function iconElement(of: IconNode): HTMLElement {
  const host = document.createElement("span");
  host.setAttribute("aria-hidden", "true");
  render(<Icon of={of} size={16} />, host);
  return host;
}
