/** Numbers over time: any numeric field of any topic, on several axes, with pause, zoom and export. */

import { Choice, Search } from "../../forms/inputs";
import "uplot/dist/uPlot.min.css";
import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type uPlot from "uplot";
import { useLater } from "../../forms/later";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { numberAt, numericPaths } from "../../robot/fields";
import type { Message } from "../../robot/subscriptions";
import { componentPanel, saveAs } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { Series } from "./series";

/** One line of the plot. */
export interface Line {
  topic: string;
  path: string;
  /** On the axis at the right. */
  right?: boolean;
}

/** Milliseconds between two drawings. */
const REDRAW = 50;
const COLOURS = ["#1f5fa8", "#c2410c", "#15803d", "#9333ea", "#b91c1c", "#0e7490", "#a16207", "#be185d"];
const MOST_LINES = COLOURS.length;
/** Topics beyond which the list has a search, and that it shows. */
const SEARCHED = 40;
const MOST_TOPICS = 500;
/** Pixels that the mouse must go to choose a part. */
const LEAST_DRAG = 4;

export const plot: PanelKind = {
  name: "plot",
  title: "plot.title",
  supportedTypes: ["nav_msgs/Odometry", "std_msgs/Float64", "std_msgs/Float32"],
  opens: (session) =>
    session.topicsOf("nav_msgs/Odometry", "std_msgs/Float64", "std_msgs/Float32").length > 0,
  place: "below",
  init: componentPanel(PlotPanel),
};

/** Default series: the speed of the robot. */
function usualLines(context: PanelContext): Line[] {
  const { session } = context;
  const odometry = session.topicsOf("nav_msgs/Odometry")[0];
  if (odometry) {
    return [
      { topic: odometry, path: "twist.twist.linear.x" },
      { topic: odometry, path: "twist.twist.angular.z", right: true },
    ];
  }
  const number = session.topicsOf("std_msgs/Float64", "std_msgs/Float32")[0];
  return number ? [{ topic: number, path: "data" }] : [];
}

function PlotPanel({ context }: { context: PanelContext }) {
  const { session, config, visible } = context;
  const key = JSON.stringify((config.value.lines as Line[] | undefined) ?? usualLines(context));
  const lines = useMemo(() => JSON.parse(key) as Line[], [key]);
  const paused = useSignal(false);
  const series = useMemo(() => lines.map(() => new Series()), [lines]);
  const isVisible = visible.value;
  useEffect(() => {
    if (!isVisible) return undefined;
    const ends = lines.map(({ topic, path }, at) =>
      session.subscribe(topic, session.graph.peek().topics.get(topic) ?? "", (message) => {
        if (!paused.peek()) series[at]?.push(Date.now() / 1000, numberAt(message, path));
      }),
    );
    return () => {
      for (const end of ends) end();
    };
  }, [session, lines, isVisible, paused, series]);
  const span = useSignal<Span | null>(null);
  /** Show a part of what there is, which then stands still: around its middle, or beside it. */
  const show = (share: number, aside: number) => {
    const times = Series.together(series)[0] ?? [];
    const whole: Span = [times[0] ?? 0, times.at(-1) ?? 0];
    if (whole[1] <= whole[0]) return;
    paused.value = true;
    span.value = partOf(span.value ?? whole, whole, share, aside);
  };
  const change = (next: Line[]) => {
    config.value = { ...config.value, lines: next };
  };
  return (
    <div class="plot">
      <div class="plot-bar">
        <button
          type="button"
          aria-pressed={paused.value}
          onClick={() => {
            paused.value = !paused.value;
            if (!paused.value) span.value = null;
          }}
        >
          {t("plot.pause")}
        </button>
        <button type="button" onClick={() => exportCsv(lines, series)}>
          {t("plot.export")}
        </button>
        <fieldset class="plot-zoom" aria-label={t("plot.zoom")}>
          <Zoom sign="−" name="plot.zoom.out" onPress={() => show(2, 0)} />
          <Zoom sign="+" name="plot.zoom.in" onPress={() => show(0.5, 0)} />
          <Zoom sign="◂" name="plot.earlier" onPress={() => show(1, -0.5)} />
          <Zoom sign="▸" name="plot.later" onPress={() => show(1, 0.5)} />
          {span.value && (
            <button
              type="button"
              onClick={() => {
                span.value = null;
              }}
            >
              {t("plot.all")}
            </button>
          )}
        </fieldset>
        {span.value && (
          <output>{t("plot.span", { seconds: (span.value[1] - span.value[0]).toFixed(2) })}</output>
        )}
        {lines.length < MOST_LINES && (
          <AddLine context={context} onAdd={(line) => change([...lines, line])} />
        )}
      </div>
      <ul class="plot-lines">
        {lines.map((line, at) => (
          <PlotLine
            key={`${line.topic} ${line.path}`}
            line={line}
            colour={COLOURS[at] ?? ""}
            onRemove={() => change(lines.filter((_, index) => index !== at))}
            onSide={() =>
              change(lines.map((each, index) => (index === at ? { ...each, right: !each.right } : each)))
            }
          />
        ))}
      </ul>
      {lines.length === 0 && <p class="faint">{t("plot.choose")}</p>}
      <Chart
        key={key}
        lines={lines}
        series={series}
        visible={isVisible}
        paused={paused}
        span={span}
        dark={context.dark.value}
      />
    </div>
  );
}

function Zoom(props: {
  sign: string;
  name: "plot.zoom.in" | "plot.zoom.out" | "plot.earlier" | "plot.later";
  onPress: () => void;
}) {
  const { sign, name, onPress } = props;
  return (
    <button type="button" aria-label={t(name)} title={t(name)} onClick={onPress}>
      {sign}
    </button>
  );
}

/** Seconds since 1970 from which and until which is shown. */
type Span = [from: number, until: number];
/** Seconds that are shown at least. */
const LEAST_SPAN = 0.02;

/**
 * Another part of a whole: a share of the part that was shown around its middle, and moved by a share of its length;
 * null for all of it.
 */
function partOf(shown: Span, whole: Span, share: number, aside: number): Span | null {
  const length = Math.max((shown[1] - shown[0]) * share, LEAST_SPAN);
  if (length >= whole[1] - whole[0]) return null;
  const middle = (shown[0] + shown[1]) / 2 + aside * (shown[1] - shown[0]);
  const from = Math.min(Math.max(middle - length / 2, whole[0]), whole[1] - length);
  return [from, from + length];
}

function PlotLine(props: { line: Line; colour: string; onRemove: () => void; onSide: () => void }) {
  const { line, colour, onRemove, onSide } = props;
  const mark = useRef<HTMLSpanElement>(null);
  useEffect(() => {
    if (mark.current) mark.current.style.background = colour;
  }, [colour]);
  const name = `${line.topic} ${line.path}`;
  return (
    <li>
      <span class="plot-mark" ref={mark} aria-hidden="true" />
      <span title={name}>{name}</span>
      <button
        type="button"
        aria-pressed={line.right ?? false}
        aria-label={t("plot.right", { name })}
        onClick={onSide}
      >
        ⇥
      </button>
      <button type="button" aria-label={t("form.remove", { name })} onClick={onRemove}>
        ×
      </button>
    </li>
  );
}

/** Choosing a topic, and then one of the numbers in its messages. */
/** A form that adds a field of a topic; `pathsOf` finds those that can be chosen. */
export function AddLine(props: {
  context: PanelContext;
  pathsOf?: (message: Message) => string[];
  onAdd: (line: Line) => void;
}) {
  const { context, pathsOf = numericPaths, onAdd } = props;
  const { session } = context;
  const topic = useSignal("");
  const path = useSignal("");
  const sample = useSignal<Message | null>(null);
  const chosen = topic.value;
  useEffect(() => {
    sample.value = null;
    path.value = "";
    if (!chosen) return undefined;
    const type = session.graph.peek().topics.get(chosen) ?? "";
    return session.subscribe(
      chosen,
      type,
      (message) => {
        sample.value ??= message;
      },
      { throttle: 500 },
    );
  }, [session, chosen, sample, path]);
  const paths = sample.value ? pathsOf(sample.value) : [];
  const search = useSignal("");
  const topics = [...session.graph.value.topics.keys()]
    .filter((name) => session.may("subscribe", name))
    .sort();
  const wanted = search.value.toLowerCase();
  const found = topics.filter((name) => name.toLowerCase().includes(wanted) || name === chosen);
  // With a button to end it: arrow keys choose one value after the other on their way.
  return (
    <form
      class="plot-bar"
      onSubmit={(event) => {
        event.preventDefault();
        if (path.value) onAdd({ topic: chosen, path: path.value });
        topic.value = "";
      }}
    >
      {topics.length > SEARCHED && <Search text={search} />}
      <Choice
        label={t("panel.topic")}
        quiet
        chosen={chosen}
        options={[["", t("plot.topic")], ...found.slice(0, MOST_TOPICS)]}
        onChoose={(name) => {
          topic.value = name;
        }}
      />
      {chosen && (
        <>
          <Choice
            label={t("plot.field")}
            quiet
            chosen={path.value}
            options={[["", sample.value ? t("plot.field") : t("panel.waiting", { name: chosen })], ...paths]}
            onChoose={(name) => {
              path.value = name;
            }}
          />
          <button type="submit" disabled={!path.value}>
            {t("plot.add")}
          </button>
        </>
      )}
    </form>
  );
}

interface ChartProps {
  lines: Line[];
  series: Series[];
  visible: boolean;
  paused: Signal<boolean>;
  /** Shown time span; null for all. */
  span: Signal<Span | null>;
  dark: boolean;
}

function Chart({ lines, series, visible, paused, span, dark }: ChartProps) {
  const place = useRef<HTMLDivElement>(null);
  const chart = useRef<uPlot | null>(null);
  const problem = useLater(
    () => import("uplot"),
    ({ default: UPlot }) => {
      const host = place.current as HTMLDivElement;
      const ink = dark ? "#a4acb6" : "#565d66";
      const axis = { stroke: ink, grid: { stroke: dark ? "#2c333b" : "#dde1e6" }, ticks: { stroke: ink } };
      const right = lines.some((line) => line.right);
      const made = new UPlot(
        {
          width: host.clientWidth || 300,
          height: Math.max(80, host.clientHeight),
          legend: { show: false },
          cursor: {
            drag: { x: true, y: false, setScale: false },
            bind: {
              dblclick: () => () => {
                span.value = null;
                return null;
              },
            },
          },
          hooks: {
            setSelect: [
              (plot: uPlot) => {
                const { left, width } = plot.select;
                if (width < LEAST_DRAG) return;
                paused.value = true;
                span.value = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
                plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
              },
            ],
          },
          scales: {
            x: { time: true, range: (_, least, most) => span.peek() ?? [least, most] },
            y: { range: around },
            right: { range: around },
          },
          axes: [
            axis,
            { ...axis, scale: "y" },
            ...(right ? [{ ...axis, scale: "right", side: 1 as const, grid: { show: false } }] : []),
          ],
          series: [
            {},
            ...lines.map((line, at) => ({
              scale: line.right ? "right" : "y",
              stroke: COLOURS[at] as string,
              width: 1.5,
              points: { show: false },
              spanGaps: true,
            })),
          ],
        },
        Series.together(series) as uPlot.AlignedData,
        host,
      );
      chart.current = made;
      const sizes = new ResizeObserver(() => {
        if (host.clientWidth)
          made.setSize({ width: host.clientWidth, height: Math.max(80, host.clientHeight) });
      });
      sizes.observe(host);
      return () => {
        sizes.disconnect();
        made.destroy();
        chart.current = null;
      };
    },
    [lines, series, dark],
  );
  const stands = paused.value;
  const shown = span.value;
  useEffect(() => {
    if (!visible) return undefined;
    const draw = () => chart.current?.setData(Series.together(series) as uPlot.AlignedData);
    draw();
    if (stands) return undefined;
    const timer = setInterval(draw, REDRAW);
    return () => clearInterval(timer);
  }, [visible, stands, shown, series]);
  const name = lines.map(({ topic, path }) => `${topic} ${path}`).join(", ");
  return (
    <>
      {problem && <Problem text={problem} />}
      <div class="plot-chart" ref={place} role="img" aria-label={t("plot.chart", { name })} />
    </>
  );
}

/** The range of an axis: around a line that lies flat, too. */
function around(_: uPlot, least: number, most: number): [number, number] {
  const room = (most - least) * 0.05 || 1;
  return [least - room, most + room];
}

function exportCsv(lines: Line[], series: Series[]): void {
  const quote = (text: string) => `"${text.replaceAll('"', '""')}"`;
  const [times = [], ...values] = Series.together(series);
  const head = ["time", ...lines.map(({ topic, path }) => quote(`${topic} ${path}`))].join(",");
  const rows = Array.from(times, (time, at) =>
    [(time as number).toFixed(6), ...values.map((each) => each[at] ?? "")].join(","),
  );
  saveAs(new Blob([`${[head, ...rows].join("\n")}\n`], { type: "text/csv" }), "plot.csv");
}
