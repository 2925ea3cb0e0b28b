/** The style of `<rwt-teleop>`. */
export const style = `
:host {
  display: inline-block;
}
.drive {
  display: flex;
  flex-wrap: wrap;
  align-items: center;
  gap: 1em;
  margin: 0;
  padding: 4px;
  border: 0;
  min-width: 0;
}
.stick {
  display: grid;
  place-items: center;
  width: 10.5em;
  aspect-ratio: 1;
  border: 2px solid var(--rwt-line);
  border-radius: 50%;
  background: color-mix(in srgb, CanvasText 6%, Canvas);
  touch-action: none;
  user-select: none;
  cursor: grab;
}
.disabled {
  opacity: 0.5;
}
.knob {
  width: 4em;
  aspect-ratio: 1;
  border-radius: 50%;
  background: var(--rwt-accent);
  pointer-events: none;
}
.drive-buttons {
  border: 0;
  margin: 0;
  padding: 0;
  min-width: 0;
  display: grid;
  grid-template-columns: repeat(3, auto);
  gap: 0.3em;
}
.drive-buttons button {
  width: 3.2em;
  height: 3.2em;
  touch-action: none;
  user-select: none;
}
/* In the order of the page, with room between what goes left and what goes right. */
.drive-right,
.drive-sideways_right {
  grid-column: 3;
}
.speeds {
  flex-basis: 100%;
  font-variant-numeric: tabular-nums;
}
.driver {
  flex-basis: 100%;
  margin: 0;
}
.driver .dot {
  display: inline-block;
  width: 0.7em;
  height: 0.7em;
  margin-inline-end: 0.4em;
  border-radius: 50%;
  background: var(--rwt-faint);
}
.driver.held .dot {
  background: var(--rwt-accent);
}
`;
