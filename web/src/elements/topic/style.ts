/** The style of `<rwt-topic>`. */
export const style = `
:host {
  display: inline-block;
  max-width: 100%;
}
.message {
  font-family: ui-monospace, monospace;
  white-space: pre-wrap;
  max-height: 20em;
  overflow: auto;
}
output {
  font-variant-numeric: tabular-nums;
}
`;
