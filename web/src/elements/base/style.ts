/** The style of every element; an element's own comes after it. */
export const style = `
:host {
  display: block;
  font: 15px / 1.45 system-ui, sans-serif;
  color: CanvasText;
  --rwt-accent: #1f5fa8;
  --rwt-danger: #b3121d;
  --rwt-line: color-mix(in srgb, CanvasText 30%, Canvas);
  --rwt-faint: color-mix(in srgb, CanvasText 70%, Canvas);
}
:host([hidden]) {
  display: none;
}
* {
  box-sizing: border-box;
}
p {
  margin: 0.3em 0;
  overflow-wrap: anywhere;
}
.frame {
  position: relative;
  height: 100%;
  min-width: 0;
}
.problem {
  border-left: 4px solid var(--rwt-danger);
  background: Canvas;
  color: CanvasText;
  padding: 0.3em 0.6em;
}
.faint {
  color: var(--rwt-faint);
}
button,
input,
select {
  font: inherit;
  min-height: 2.2em;
}
:focus-visible {
  outline: 3px solid var(--rwt-accent);
  outline-offset: 2px;
}
.hidden {
  position: absolute;
  width: 1px;
  height: 1px;
  overflow: hidden;
  clip-path: inset(50%);
}
`;
