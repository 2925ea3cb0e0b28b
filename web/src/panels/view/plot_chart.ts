/** The picture of a plot: axes and selection by uPlot, lines by this; loaded with the first plot. */

import type { Signal } from "@preact/signals";
import UPlot from "uplot";
import { clockText } from "../../i18n/formats";
import type { Extent, Series } from "./series";

/** Shown seconds since 1970. */
export type Span = [from: number, until: number];

/** One line of the picture. */
export interface Curve {
  series: Series;
  right: boolean;
  /** Place of its colour among the tokens, and whether it is dashed. */
  colour: number;
  dashed: boolean;
}

/** What is drawn. */
export interface Drawing {
  curves: Curve[];
  /** Values of the horizontal axis; null for time. */
  x: Series | null;
  /** Horizontal lines at values of the left axis. */
  marks: readonly number[];
  /** Shown part; null for all. */
  span: Signal<Span | null>;
  /** Time that all plots point at. */
  cursor: Signal<number | null>;
  /** Told of a part that was selected; null for all. */
  onSelect(span: Span | null): void;
}

/** Pixels that the mouse must go to choose a part. */
const LEAST_DRAG = 4;
/** Points of a line against another field that are drawn. */
const MOST_POINTS = 50_000;
const DASHES = [5, 4];
const FONT = '11px "Inter Variable", system-ui, sans-serif';

/** First and last time of all series together. */
export function wholeSpan(all: readonly Series[]): Span {
  let [from, until] = [Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
  for (const { span } of all) {
    if (!span) continue;
    from = Math.min(from, span[0]);
    until = Math.max(until, span[1]);
  }
  return from <= until ? [from, until] : [0, 0];
}

/** Extent of several ones with some room, also around a flat line. */
export function roomy(extents: readonly Extent[]): Extent {
  const least = Math.min(...extents.map(([from]) => from));
  const most = Math.max(...extents.map(([, until]) => until));
  if (!(least <= most)) return [-1, 1];
  const room = (most - least) * 0.05 || Math.abs(most) * 0.1 || 1;
  return [least - room, most + room];
}

function timeText(seconds: number, step: number): string {
  return clockText(seconds * 1000, step >= 1 ? 0 : step >= 0.1 ? 1 : step >= 0.01 ? 2 : 3);
}

/** A number for an axis or a table. */
export function shortNumber(value: number): string {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const text =
    size !== 0 && (size >= 1e6 || size < 1e-3)
      ? value.toExponential(2)
      : String(Number(value.toPrecision(4)));
  return text.replace("-", "−");
}

/** Draw in an element until `end` is called; `redraw` shows what has come since. */
export function drawPlot(host: HTMLElement, drawing: Drawing): { redraw(): void; end(): void } {
  const { curves, x, marks, span, cursor } = drawing;
  const style = getComputedStyle(host);
  // Read with each drawing: the panel may not be in the page yet, and the theme changes.
  const token = (name: string) => style.getPropertyValue(name).trim();
  const axis = {
    stroke: () => token("--text-3"),
    font: FONT,
    grid: { stroke: () => token("--line"), width: 1 },
    ticks: { show: false },
    border: { show: false },
  };
  const numbers = (_: UPlot, values: number[]) => values.map(shortNumber);
  const hasRight = curves.some(({ right }) => right);
  const series = curves.map((each) => each.series);
  const size = () => ({ width: host.clientWidth || 300, height: Math.max(80, host.clientHeight) });
  const shown = (): Span => span.peek() ?? wholeSpan(series);
  /** The ends of the three axes: uPlot is given no other data. */
  const ends = (): UPlot.AlignedData => {
    const [from, until] = shown();
    const side = (right: boolean) => {
      const own = curves
        .filter((each) => each.right === right)
        .map((each) => each.series.extent(from, until));
      if (!right) own.push(...marks.map((mark): Extent => [mark, mark]));
      return roomy(own);
    };
    return [x ? roomy([x.extent(from, until)]) : [from, until || 1], side(false), side(true)];
  };
  const asGiven = (_: UPlot, least: number, most: number): UPlot.Range.MinMax => [least, most];
  const nothing = { paths: () => null, points: { show: false } };
  const pointer = document.createElement("div");
  pointer.className = "plot-cursor";
  const chart = new UPlot(
    {
      ...size(),
      legend: { show: false },
      cursor: {
        x: false,
        y: false,
        points: { show: false },
        drag: { x: x === null, y: false, setScale: false },
        bind: {
          dblclick: () => () => {
            drawing.onSelect(null);
            return null;
          },
        },
      },
      scales: { x: { time: false, range: asGiven }, y: { range: asGiven }, right: { range: asGiven } },
      axes: [
        {
          ...axis,
          space: 70,
          values: x ? numbers : (_, values, __, ___, step) => values.map((value) => timeText(value, step)),
        },
        { ...axis, scale: "y", values: numbers },
        ...(hasRight
          ? [{ ...axis, scale: "right", side: 1 as const, grid: { show: false }, values: numbers }]
          : []),
      ],
      series: [{}, { ...nothing, scale: "y" }, { ...nothing, scale: "right" }],
      hooks: {
        ready: [({ over }) => over.append(pointer)],
        draw: [draw],
        setCursor: [
          ({ cursor: { left = -1 }, posToVal }) => {
            // Only of a mouse that is here: other plots move the cursor, too.
            if (left >= 0 && !x) cursor.value = posToVal(left, "x");
          },
        ],
        setSelect: [
          (plot) => {
            const { left, width } = plot.select;
            if (width < LEAST_DRAG) return;
            drawing.onSelect([plot.posToVal(left, "x"), plot.posToVal(left + width, "x")]);
            plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          },
        ],
      },
    },
    ends(),
    host,
  );

  function draw(plot: UPlot): void {
    const { ctx, bbox } = plot;
    const [from, until] = shown();
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineJoin = ctx.lineCap = "round";
    for (const mark of marks) {
      const y = Math.round(plot.valToPos(mark, "y", true));
      ctx.strokeStyle = ctx.fillStyle = token("--warn");
      ctx.lineWidth = devicePixelRatio;
      ctx.setLineDash([2, 3].map((each) => each * devicePixelRatio));
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.font = `${11 * devicePixelRatio}px ${FONT.slice(5)}`;
      ctx.fillText(shortNumber(mark), bbox.left + 4 * devicePixelRatio, y - 3 * devicePixelRatio);
    }
    ctx.lineWidth = 1.75 * devicePixelRatio;
    for (const { series, right, colour, dashed } of curves) {
      ctx.strokeStyle = token(`--p${colour}`);
      ctx.setLineDash(dashed ? DASHES.map((each) => each * devicePixelRatio) : []);
      ctx.beginPath();
      let isDown = false;
      let [lastX, lastY] = [Number.NaN, Number.NaN];
      const point = (across: number, value: number) => {
        if (!Number.isFinite(value) || !Number.isFinite(across)) {
          isDown = false;
          return;
        }
        const at = plot.valToPos(across, "x", true);
        const y = plot.valToPos(value, right ? "right" : "y", true);
        if (isDown && Math.abs(at - lastX) < 0.5 && Math.abs(y - lastY) < 0.5) return;
        // A point alone is a dot.
        if (!isDown) ctx.moveTo(at, y);
        ctx.lineTo(at, y);
        [isDown, lastX, lastY] = [true, at, y];
      };
      if (x) series.drawAgainst(x, from, until, MOST_POINTS, point);
      else series.draw(from, until, Math.max(1, Math.round(bbox.width / devicePixelRatio)), point);
      ctx.stroke();
    }
    ctx.restore();
  }

  const point = () => {
    const time = cursor.value;
    const [from, until] = shown();
    const isShown = time !== null && !x && time >= from && time <= until;
    pointer.hidden = !isShown;
    if (isShown) {
      pointer.style.transform = `translateX(${Math.round(chart.valToPos(time, "x"))}px)`;
      pointer.dataset.time = timeText(time, 0.01);
    }
  };
  const endPointing = cursor.subscribe(point);
  const leave = () => {
    cursor.value = null;
  };
  chart.over.addEventListener("mouseleave", leave);
  const sizes = new ResizeObserver(() => {
    if (host.clientWidth) chart.setSize(size());
  });
  sizes.observe(host);
  return {
    redraw: () => {
      chart.setData(ends());
      point();
    },
    end: () => {
      endPointing();
      sizes.disconnect();
      chart.destroy();
    },
  };
}
