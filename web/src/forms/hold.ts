/** Controls that act while they are held. */

/** Handlers of a button that is held by the pointer's main button, by Enter or by the space bar. */
export function holdHandlers(hold: () => void, letGo: () => void) {
  const isPress = ({ key }: KeyboardEvent) => key === " " || key === "Enter";
  return {
    onPointerDown: (event: PointerEvent) => {
      if (event.button !== 0) return;
      (event.currentTarget as HTMLElement).setPointerCapture(event.pointerId);
      hold();
    },
    onPointerUp: letGo,
    onPointerCancel: letGo,
    onLostPointerCapture: letGo,
    onContextMenu: (event: Event) => event.preventDefault(),
    onKeyDown: (event: KeyboardEvent) => {
      if (!isPress(event)) return;
      event.preventDefault();
      if (!event.repeat) hold();
    },
    onKeyUp: (event: KeyboardEvent) => {
      if (isPress(event)) letGo();
    },
    onBlur: letGo,
  };
}
