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
  grid-template-areas: "fl f fr" "l . r" "bl b br" "sl . sr";
  gap: 0.3em;
}
.drive-buttons button {
  width: 3.2em;
  height: 3.2em;
  touch-action: none;
  user-select: none;
}
.drive-forward_left {
  grid-area: fl;
}
.drive-forward_right {
  grid-area: fr;
}
.drive-back_left {
  grid-area: bl;
}
.drive-back_right {
  grid-area: br;
}
.drive-sideways_left {
  grid-area: sl;
}
.drive-sideways_right {
  grid-area: sr;
}
.drive-forward {
  grid-area: f;
}
.drive-back {
  grid-area: b;
}
.drive-left {
  grid-area: l;
}
.drive-right {
  grid-area: r;
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
