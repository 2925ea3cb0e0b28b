/** Controls that drive while they are held: a stick, buttons and keys; the panel and the element have them in common. */

import { useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { holdHandlers } from "../../forms/hold";
import { useTexts } from "../../i18n/context";
import { type Drive, NO_WISH, type Wish } from "../../robot/drive";

/** Request of each key while it is held. */
const KEYS: Record<string, Wish> = {
  ArrowUp: { forward: 1, left: 0, turn: 0 },
  ArrowDown: { forward: -1, left: 0, turn: 0 },
  ArrowLeft: { forward: 0, left: 0, turn: 1 },
  ArrowRight: { forward: 0, left: 0, turn: -1 },
  w: { forward: 1, left: 0, turn: 0 },
  s: { forward: -1, left: 0, turn: 0 },
  a: { forward: 0, left: 0, turn: 1 },
  d: { forward: 0, left: 0, turn: -1 },
  q: { forward: 0, left: 1, turn: 0 },
  e: { forward: 0, left: -1, turn: 0 },
};

/** The wish of all keys that are held together. */
export function wishOfKeys(held: Iterable<string>): Wish {
  const sum = { ...NO_WISH };
  for (const key of held) {
    const wish = KEYS[key];
    if (!wish) continue;
    sum.forward += wish.forward;
    sum.left += wish.left;
    sum.turn += wish.turn;
  }
  return sum;
}

/** Fraction of the turning speed used in a curve. */
const CURVE = 0.5;

const BUTTONS = [
  { name: "forward_left", sign: "↖", wish: { forward: 1, left: 0, turn: CURVE } },
  { name: "forward", sign: "▲", wish: { forward: 1, left: 0, turn: 0 } },
  { name: "forward_right", sign: "↗", wish: { forward: 1, left: 0, turn: -CURVE } },
  { name: "left", sign: "↺", wish: { forward: 0, left: 0, turn: 1 } },
  { name: "right", sign: "↻", wish: { forward: 0, left: 0, turn: -1 } },
  { name: "back_left", sign: "↙", wish: { forward: -1, left: 0, turn: CURVE } },
  { name: "back", sign: "▼", wish: { forward: -1, left: 0, turn: 0 } },
  { name: "back_right", sign: "↘", wish: { forward: -1, left: 0, turn: -CURVE } },
] as const;

/** For robots that can drive sideways. */
const SIDEWAYS = [
  { name: "sideways_left", sign: "⇐", wish: { forward: 0, left: 1, turn: 0 } },
  { name: "sideways_right", sign: "⇒", wish: { forward: 0, left: -1, turn: 0 } },
] as const;

/** Let go of every control when the page is hidden or left, or loses the keyboard; returns what ends that. */
export function releaseWithPage(drive: Pick<Drive, "releaseAll">, onHidden?: () => void): () => void {
  const letGo = () => drive.releaseAll();
  const whenHidden = () => {
    if (!document.hidden) return;
    letGo();
    onHidden?.();
  };
  addEventListener("blur", letGo);
  addEventListener("pagehide", letGo);
  document.addEventListener("visibilitychange", whenHidden);
  return () => {
    removeEventListener("blur", letGo);
    removeEventListener("pagehide", letGo);
    document.removeEventListener("visibilitychange", whenHidden);
  };
}

/** A button for each direction. */
export function HoldButtons(props: { drive: Drive; disabled: boolean; sideways?: boolean }) {
  const t = useTexts();
  const { drive, disabled, sideways = false } = props;
  return (
    <fieldset part="buttons" class="drive-buttons" data-scan-group aria-label={t("teleop.directions")}>
      {[...BUTTONS, ...(sideways ? SIDEWAYS : [])].map(({ name, sign, wish }) => (
        <HoldButton key={name} drive={drive} name={name} sign={sign} wish={wish} disabled={disabled} />
      ))}
    </fieldset>
  );
}

/** A button that acts while it is held, by pointer, by Enter or the space bar. */
function HoldButton(props: { drive: Drive; name: string; sign: string; wish: Wish; disabled: boolean }) {
  const t = useTexts();
  const { drive, name, sign, wish, disabled } = props;
  const control = `button ${name}`;
  return (
    <button
      type="button"
      part="button"
      class={`drive-${name}`}
      data-scan="hold"
      disabled={disabled}
      aria-label={t(`teleop.${name as "forward"}`)}
      {...holdHandlers(
        () => drive.hold(control, wish),
        () => drive.release(control),
      )}
    >
      <span aria-hidden="true">{sign}</span>
    </button>
  );
}

/** A stick for a thumb or the mouse: up is forward, left turns left. */
export function Stick({ drive, disabled }: { drive: Drive; disabled: boolean }) {
  const knob = useSignal({ x: 0, y: 0 });
  const held = useRef<number | null>(null);
  const move = (event: PointerEvent) => {
    const box = (event.currentTarget as HTMLElement).getBoundingClientRect();
    const radius = box.width / 2;
    let x = (event.clientX - box.left - radius) / radius;
    let y = (event.clientY - box.top - radius) / radius;
    const length = Math.hypot(x, y);
    if (length > 1) {
      x /= length;
      y /= length;
    }
    knob.value = { x, y };
    drive.hold("stick", { forward: -y, left: 0, turn: -x });
  };
  const letGo = () => {
    held.current = null;
    knob.value = { x: 0, y: 0 };
    drive.release("stick");
  };
  useSignalEffect(() => {
    // After a loss of the drive the knob goes back as well: only another grip drives.
    if (!drive.moving.value && held.current !== null) letGo();
  });
  const place = useRef<HTMLSpanElement>(null);
  const { x, y } = knob.value;
  useEffect(() => {
    place.current?.style.setProperty("transform", `translate(${x * 100}%, ${y * 100}%)`);
  }, [x, y]);
  return (
    <div
      part="stick"
      class={`stick${disabled ? " disabled" : ""}`}
      aria-hidden="true"
      onPointerDown={(event) => {
        if (disabled) return;
        held.current = event.pointerId;
        event.currentTarget.setPointerCapture(event.pointerId);
        move(event);
      }}
      onPointerMove={(event) => {
        if (held.current !== event.pointerId) return;
        // What was stopped, or lost its connection, begins again with another grip only.
        if (drive.holds("stick")) move(event);
        else letGo();
      }}
      onPointerUp={letGo}
      onPointerCancel={letGo}
      onLostPointerCapture={letGo}
    >
      <span part="knob" class="knob" ref={place} />
    </div>
  );
}

/** Return true if what has the focus takes keys for itself, as a text field and a slider do. */
function takesKeys(event: Event): boolean {
  const target = event.composedPath()[0];
  return (
    target instanceof HTMLElement && (target.isContentEditable || target.matches("input, textarea, select"))
  );
}

/**
 * Drive by the keys that are held while the keyboard is in an element.
 *
 * @param counts whether a key that another control has not used drives
 */
export function followKeys(
  element: HTMLElement | Document,
  drive: Drive,
  counts: (event: KeyboardEvent) => boolean = () => true,
): () => void {
  const held = new Set<string>();
  const changed = () => {
    if (held.size) drive.hold("keys", wishOfKeys(held));
    else drive.release("keys");
  };
  // Keys that were down when the drive was stopped, or lost its connection, count again once they are pressed anew.
  const forgetLost = () => {
    if (!drive.holds("keys")) held.clear();
  };
  const keyOf = (event: KeyboardEvent) => (event.key.length === 1 ? event.key.toLowerCase() : event.key);
  const down = (event: KeyboardEvent) => {
    const key = keyOf(event);
    if (!(key in KEYS) || takesKeys(event) || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.defaultPrevented || !counts(event)) return;
    event.preventDefault();
    // A key that repeats was pressed before: perhaps for a connection that is lost, or before the page was left.
    if (event.repeat) return;
    forgetLost();
    held.add(key);
    changed();
  };
  const up = (event: KeyboardEvent) => {
    forgetLost();
    if (held.delete(keyOf(event))) changed();
  };
  const letGo = () => {
    held.clear();
    changed();
  };
  const pressed = down as EventListener;
  element.addEventListener("keydown", pressed);
  document.addEventListener("keyup", up);
  element.addEventListener("focusout", letGo);
  addEventListener("blur", letGo);
  return () => {
    element.removeEventListener("keydown", pressed);
    document.removeEventListener("keyup", up);
    element.removeEventListener("focusout", letGo);
    removeEventListener("blur", letGo);
    letGo();
  };
}
