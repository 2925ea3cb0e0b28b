/** The style of `<rwt-plot>`. */

/** Of the curves, one after another; each is seen on white and on black. */
export const COLOURS = ["#2f7ed8", "#d1495b", "#2e8b57", "#b8860b", "#8b5fbf", "#5f7a8a"] as const;

export const style = `
.plot {
  display: flex;
  flex-direction: column;
  gap: 0.3em;
  height: 100%;
}
.chart {
  min-height: 180px;
  flex: 1;
  position: relative;
  overflow: hidden;
}
.legend {
  display: flex;
  flex-wrap: wrap;
  gap: 0.2em 1.2em;
  margin: 0;
  padding: 0;
  list-style: none;
  font-variant-numeric: tabular-nums;
}
.sign {
  display: inline-block;
  width: 1.2em;
  height: 0.25em;
  vertical-align: middle;
}
${COLOURS.map((colour, index) => `.sign-${index} { background: ${colour}; }`).join("\n")}
button {
  align-self: start;
}
.uplot,
.uplot * {
  box-sizing: border-box;
}
.u-wrap {
  position: relative;
}
.u-over,
.u-under {
  position: absolute;
}
.u-under {
  overflow: hidden;
}
.uplot canvas {
  display: block;
  position: relative;
  width: 100%;
  height: 100%;
}
.u-axis {
  position: absolute;
}
`;
