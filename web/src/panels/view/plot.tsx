/** Numbers over time: any numeric field of any topic, on several axes, with pause, zoom and export. */

import { Choice } from "../../forms/inputs";
import "uplot/dist/uPlot.min.css";
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type uPlot from "uplot";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { numberAt, numericPaths } from "../../robot/fields";
import type { Message } from "../../robot/subscriptions";
import { componentPanel } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { Series } from "./series";

/** One line of the plot. */
interface Line {
  topic: string;
  path: string;
  /** On the axis at the right. */
  right?: boolean;
}

/** Milliseconds between two drawings. */
const REDRAW = 50;
const COLOURS = ["#1f5fa8", "#c2410c", "#15803d", "#9333ea", "#b91c1c", "#0e7490", "#a16207", "#be185d"];
const MOST_LINES = COLOURS.length;

export const plot: PanelKind = {
  name: "plot",
  title: "plot.title",
  supportedTypes: ["nav_msgs/Odometry", "std_msgs/Float64", "std_msgs/Float32"],
  opens: (session) =>
    session.topicsOf("nav_msgs/Odometry", "std_msgs/Float64", "std_msgs/Float32").length > 0,
  place: "below",
  init: componentPanel(PlotPanel),
};

/** What is plotted where nothing has been chosen: how fast the robot is. */
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
          }}
        >
          {t("plot.pause")}
        </button>
        <button type="button" onClick={() => exportCsv(lines, series)}>
          {t("plot.export")}
        </button>
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
        paused={paused.value}
        dark={context.dark.value}
      />
    </div>
  );
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
      {name}
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
function AddLine({ context, onAdd }: { context: PanelContext; onAdd: (line: Line) => void }) {
  const { session } = context;
  const topic = useSignal("");
  const sample = useSignal<Message | null>(null);
  const chosen = topic.value;
  useEffect(() => {
    sample.value = null;
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
  }, [session, chosen, sample]);
  const paths = sample.value ? numericPaths(sample.value) : [];
  const topics = [...session.graph.value.topics.keys()]
    .filter((name) => session.may("subscribe", name))
    .sort();
  return (
    <>
      <Choice
        label={t("panel.topic")}
        quiet
        chosen={chosen}
        options={[["", t("plot.topic")], ...topics.slice(0, 500)]}
        onChoose={(name) => {
          topic.value = name;
        }}
      />
      {chosen && (
        <Choice
          label={t("plot.field")}
          quiet
          chosen=""
          options={[["", sample.value ? t("plot.field") : t("panel.waiting", { name: chosen })], ...paths]}
          onChoose={(path) => {
            onAdd({ topic: chosen, path });
            topic.value = "";
          }}
        />
      )}
    </>
  );
}

interface ChartProps {
  lines: Line[];
  series: Series[];
  visible: boolean;
  paused: boolean;
  dark: boolean;
}

function Chart({ lines, series, visible, paused, dark }: ChartProps) {
  const place = useRef<HTMLDivElement>(null);
  const chart = useRef<uPlot | null>(null);
  const problem = useSignal("");
  useEffect(() => {
    let ended = false;
    const host = place.current as HTMLDivElement;
    const sizes = new ResizeObserver(() => {
      if (host.clientWidth)
        chart.current?.setSize({ width: host.clientWidth, height: Math.max(80, host.clientHeight) });
    });
    import("uplot")
      .then(({ default: UPlot }) => {
        if (ended) return;
        const ink = dark ? "#a4acb6" : "#565d66";
        const axis = { stroke: ink, grid: { stroke: dark ? "#2c333b" : "#dde1e6" }, ticks: { stroke: ink } };
        const right = lines.some((line) => line.right);
        chart.current = new UPlot(
          {
            width: host.clientWidth || 300,
            height: Math.max(80, host.clientHeight),
            legend: { show: false },
            cursor: { drag: { x: true, y: true, uni: 20 } },
            scales: { x: { time: true } },
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
        sizes.observe(host);
      })
      .catch((error: Error) => {
        problem.value = error.message;
      });
    return () => {
      ended = true;
      sizes.disconnect();
      chart.current?.destroy();
      chart.current = null;
    };
  }, [lines, series, dark, problem]);
  useEffect(() => {
    if (!visible || paused) return undefined;
    const timer = setInterval(
      () => chart.current?.setData(Series.together(series) as uPlot.AlignedData),
      REDRAW,
    );
    return () => clearInterval(timer);
  }, [visible, paused, series]);
  const name = lines.map(({ topic, path }) => `${topic} ${path}`).join(", ");
  return (
    <>
      {problem.value && <Problem text={problem.value} />}
      <div class="plot-chart" ref={place} role="img" aria-label={t("plot.chart", { name })} />
    </>
  );
}

function exportCsv(lines: Line[], series: Series[]): void {
  const quote = (text: string) => `"${text.replaceAll('"', '""')}"`;
  const [times = [], ...values] = Series.together(series);
  const head = ["time", ...lines.map(({ topic, path }) => quote(`${topic} ${path}`))].join(",");
  const rows = Array.from(times, (time, at) =>
    [(time as number).toFixed(6), ...values.map((each) => each[at] ?? "")].join(","),
  );
  const blob = new Blob([`${[head, ...rows].join("\n")}\n`], { type: "text/csv" });
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = "plot.csv";
  link.click();
  URL.revokeObjectURL(link.href);
}
