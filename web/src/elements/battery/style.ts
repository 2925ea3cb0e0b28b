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
/* Firefox's as Chromium's: dark enough to be seen on white, and of the same meaning. It colours no meter of its own look. */
@supports selector(::-moz-meter-bar) {
  meter {
    appearance: none;
    height: 0.8em;
    border: 1px solid var(--rwt-line);
    border-radius: 0.4em;
    overflow: hidden;
  }
}
meter:-moz-meter-optimum::-moz-meter-bar {
  background: #107c10;
}
meter:-moz-meter-sub-optimum::-moz-meter-bar {
  background: #ffb900;
}
meter:-moz-meter-sub-sub-optimum::-moz-meter-bar {
  background: #d83b01;
}
`;
