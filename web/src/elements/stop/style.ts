/** The style of `<rwt-stop>`. */
export const style = `
:host {
  display: inline-block;
}
button {
  min-width: 6em;
  min-height: 3em;
  padding: 0.4em 1.2em;
  border-radius: 8px;
  font-weight: bold;
  cursor: pointer;
}
.stop {
  background: var(--rwt-danger);
  color: #ffffff;
  border: 3px solid #7a0b13;
}
.row {
  display: flex;
  flex-wrap: wrap;
  gap: 2em;
}
.latched {
  background: Canvas;
  color: var(--rwt-danger);
}
.holding {
  text-decoration: underline;
}
.release {
  background: Canvas;
  color: CanvasText;
  border: 3px solid var(--rwt-danger);
}
`;
