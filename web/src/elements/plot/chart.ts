/** Curves on a canvas; loaded when the first plot is shown. */

import UPlot from "uplot";
import { Series } from "../../panels/view/series";
import type { PlotElement } from "./plot";
import { COLOURS } from "./style";

const HEIGHT = 220;

function axisRange(written: string): [number, number] | null {
  const [least, greatest] = written
    .trim()
    .split(/[\s,]+/)
    .map(Number);
  if (least === undefined || greatest === undefined) return null;
  return Number.isFinite(least) && Number.isFinite(greatest) && least < greatest ? [least, greatest] : null;
}

/** A range with all values in it; some of both sides of a value that is alone. */
function fittingRange(least: number | null, greatest: number | null): [number, number] {
  if (least === null || greatest === null) return [-1, 1];
  const margin = least === greatest ? Math.abs(least) || 1 : (greatest - least) * 0.1;
  return [least - margin, greatest + margin];
}

/** Draw a plot's values in a place of it until the returned function is called. */
export function drawChart(place: HTMLElement, element: PlotElement, series: Series[]): () => void {
  const style = getComputedStyle(place);
  // The colour is read with each drawing: the theme of the page around it changes.
  const axis = {
    stroke: () => style.color,
    grid: { stroke: "#8884", width: 1 },
    ticks: { stroke: "#8888", width: 1 },
  };
  const size = () => ({ width: Math.max(place.clientWidth, 100), height: place.clientHeight || HEIGHT });
  const chart = new UPlot(
    {
      ...size(),
      legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: true, range: () => [Date.now() / 1000 - element.seconds, Date.now() / 1000] },
        y: { range: (_, least, greatest) => axisRange(element.range) ?? fittingRange(least, greatest) },
      },
      axes: [axis, { ...axis, size: 56 }],
      series: [
        {},
        ...element.fields.map((label, index) => ({
          label,
          stroke: COLOURS[index % COLOURS.length] as string,
          width: 2,
          points: { show: false },
          // Dashes tell curves apart without their colours.
          dash: index === 0 ? [] : [4 + 4 * index, 4],
        })),
      ],
    },
    Series.together(series) as UPlot.AlignedData,
    place,
  );
  const resized = new ResizeObserver(() => chart.setSize(size()));
  resized.observe(place);
  let frame = requestAnimationFrame(function draw() {
    if (!element.paused) chart.setData(Series.together(series) as UPlot.AlignedData);
    frame = requestAnimationFrame(draw);
  });
  return () => {
    cancelAnimationFrame(frame);
    resized.disconnect();
    chart.destroy();
  };
}
