/** Icons of the page, from Lucide. */

import type { IconNode } from "lucide";
import { type ButtonHTMLAttributes, h, render } from "preact";

/** An icon beside a text, or in a control that has a name. */
export function Icon({ of, size = 18 }: { of: IconNode; size?: number }) {
  return (
    <svg class="icon" width={size} height={size} viewBox="0 0 24 24" aria-hidden="true">
      {of.map(([tag, attributes]) => h(tag, attributes))}
    </svg>
  );
}

/** A button that shows an icon; its name is its tooltip. */
export function IconButton(props: { of: IconNode; name: string; size?: number } & ButtonHTMLAttributes) {
  const { of, name, size = 18, ...rest } = props;
  return (
    <button type="button" {...rest}>
      <Icon of={of} size={size} />
      <span class="words">{name}</span>
    </button>
  );
}

/** An icon as an element, for what is drawn without components. */
export function iconElement(of: IconNode): HTMLElement {
  const host = document.createElement("span");
  host.setAttribute("aria-hidden", "true");
  render(<Icon of={of} size={16} />, host);
  return host;
}
