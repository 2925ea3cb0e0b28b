/** The style of `<rwt-battery>`. */
export const style = `
:host {
  display: inline-block;
}
.level {
  display: inline-flex;
  align-items: center;
  gap: 0.5em;
  font-variant-numeric: tabular-nums;
}
`;
