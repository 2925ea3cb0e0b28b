/** Interactive markers for the keyboard, and their menus. */

import { Grab } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { Menu } from "../../forms/menu";
import { t } from "../../i18n/text";
import type { Handle } from "../../scene/layers/handles";
import type { RobotScene } from "../../scene/scene";

const MOST_HANDLES = 100;

/** The controls of interactive markers by name, for the keyboard. */
export function Handles({ scene }: { scene: RobotScene }) {
  const all = scene.rows.value.flatMap(({ topic, layer }) =>
    (layer?.handles.value ?? []).map((handle) => ({ ...handle, id: `${topic} ${handle.id}` })),
  );
  if (!all.length) return null;
  return (
    <Menu label={t("scene.handles")} icon={Grab}>
      {() => (
        <>
          <p class="faint">{t("scene.handles.hint")}</p>
          <ul>
            {all.slice(0, MOST_HANDLES).map((handle) => (
              <li key={handle.id}>
                <HandleButton handle={handle} />
              </li>
            ))}
          </ul>
        </>
      )}
    </Menu>
  );
}

/** A control of a marker: arrow keys take and move it, Enter lets it go there, Escape and leaving it put it back. */
function HandleButton({ handle }: { handle: Handle }) {
  const taken = useRef(false);
  const release = (keep: boolean) => {
    if (taken.current) handle.release(keep);
    taken.current = false;
  };
  useEffect(() => () => release(false), []);
  return (
    <button
      type="button"
      onKeyDown={(event) => {
        const { key } = event;
        if (taken.current && (key === "Enter" || key === "Escape")) {
          release(key === "Enter");
        } else if (handle.key(key, event.shiftKey)) {
          taken.current = true;
        } else {
          return;
        }
        event.preventDefault();
        event.stopPropagation();
      }}
      onBlur={() => release(false)}
      onClick={(event) => {
        const { left, bottom } = event.currentTarget.getBoundingClientRect();
        handle.press({ x: left, y: bottom });
      }}
    >
      {handle.marker} · {handle.control}{" "}
      <span class="faint">{t(`scene.handle.${handle.moves ?? "press"}`)}</span>
    </button>
  );
}

/** The menu of an interactive marker. */
export function MarkerMenu({ scene }: { scene: RobotScene }) {
  const list = useRef<HTMLUListElement>(null);
  const request = scene.menu.value;
  useEffect(() => {
    if (!request) return undefined;
    list.current?.style.setProperty("left", `${request.x}px`);
    list.current?.style.setProperty("top", `${request.y}px`);
    list.current?.querySelector("button")?.focus();
    const away = (event: PointerEvent) => {
      if (!list.current?.contains(event.target as Node)) scene.menu.value = null;
    };
    addEventListener("pointerdown", away, { capture: true });
    return () => removeEventListener("pointerdown", away, { capture: true });
  }, [request, scene]);
  if (!request) return null;
  const close = () => {
    scene.menu.value = null;
    // The keyboard is not lost with the menu.
    scene.view.canvas.focus({ preventScroll: true });
  };
  const depth = (id: number): number => {
    const parent = request.entries.find((entry) => entry.id === id)?.parent_id ?? 0;
    return parent && parent !== id ? 1 + Math.min(depth(parent), 5) : 0;
  };
  return (
    <ul
      class="menu marker-menu"
      ref={list}
      onKeyDown={(event) => {
        if (event.key !== "Escape") return;
        event.stopPropagation();
        close();
      }}
    >
      {request.entries.map(({ id, title }) => (
        <li key={id}>
          <button
            type="button"
            class={`depth-${depth(id)}`}
            onClick={() => {
              close();
              request.choose(id);
            }}
          >
            {title}
          </button>
        </li>
      ))}
    </ul>
  );
}
