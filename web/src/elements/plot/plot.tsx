/** `<rwt-plot>`: values of a topic over time. */

import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { useLater } from "../../forms/later";
import { Problem } from "../../forms/problem";
import { useTexts } from "../../i18n/context";
import { Series } from "../../panels/view/series";
import { numberAt, valueAt } from "../../robot/fields";
import { flag, number, text } from "../base/attributes";
import { COMMON, defineElement, RobotElement, type ViewProps } from "../base/element";
import { type ChosenTopic, chooseTopic, NoTopic, useTopic } from "../base/topic";
import { style } from "./style";

export class PlotElement extends RobotElement {
  static override attributes = {
    ...COMMON,
    /** The topic. */
    topic: text(),
    /** The paths of the values, with blanks between them, as `linear.x angular.z`. */
    field: text("data"),
    /** Shown time span in seconds. */
    seconds: number(30, 1, 3600),
    /** Most messages a second that are taken. */
    rate: number(50, 0.1, 1000),
    /** True if the picture stands still. */
    paused: flag(),
    /** The least and the greatest value of the axis, as `-1 1`; by default what fits. */
    range: text(),
    /** Title of the plot; the default is its topic. */
    label: text(),
  };
  static override style = style;
  declare robot: string;
  declare topic: string;
  declare field: string;
  declare seconds: number;
  declare rate: number;
  declare paused: boolean;
  declare range: string;
  declare label: string;

  protected override readonly view = PlotView;

  /** @internal what is shown, a series for each path */
  series: Series[] = [];

  /** The paths of the values. */
  get fields(): string[] {
    return this.field.split(/[\s,]+/).filter((path) => path !== "");
  }

  /** Shown values as CSV: seconds since 1970, and the values. */
  csv(): string {
    const [times = [], ...columns] = Series.together(this.series);
    const rows = times.map((time, at) => [time, ...columns.map((column) => column[at] ?? "")].join(","));
    return `${[["time", ...this.fields].join(","), ...rows].join("\n")}\n`;
  }
}

function PlotView({ element, session }: ViewProps<PlotElement>) {
  const t = useTexts();
  if (!element.topic) return <Problem text={t("widget.topic.unnamed")} />;
  const topic = chooseTopic(session, element.topic, [], t);
  if ("problem" in topic) return <NoTopic problem={topic.problem} />;
  return (
    <Plot
      key={`${topic.name} ${topic.type} ${element.field} ${element.seconds}`}
      {...{ element, session, topic }}
    />
  );
}

/** Values of each curve: all of them are drawn. */
const MOST_VALUES = 65_536;
/** Milliseconds between two updates of the numbers beside the curves. */
const LEGEND_PERIOD = 250;

function Plot(props: Omit<ViewProps<PlotElement>, "stop"> & { topic: ChosenTopic }) {
  const { element, session, topic } = props;
  const t = useTexts();
  const { fields } = element;
  const place = useRef<HTMLDivElement>(null);
  const last = useSignal<number[] | null>(null);
  const newest = useRef<number[]>([]);
  const missing = useSignal("");
  const series = useMemo(
    () => fields.map(() => new Series(element.seconds, MOST_VALUES)),
    [element.field, element.seconds],
  );
  useTopic(
    session,
    topic,
    (message) => {
      const now = Date.now() / 1000;
      missing.value = fields.find((field) => valueAt(message, field) === undefined) ?? "";
      newest.current = fields.map((field) => numberAt(message, field));
      newest.current.forEach((value, index) => {
        series[index]?.push(now, value);
      });
      if (last.value === null) last.value = newest.current;
    },
    { throttle: element.rate >= 1000 ? 0 : 1000 / element.rate },
  );
  useEffect(() => {
    element.series = series;
    const timer = setInterval(() => {
      if (!element.paused && newest.current.length) last.value = newest.current;
    }, LEGEND_PERIOD);
    return () => clearInterval(timer);
  }, [element, series, last]);
  const problem = useLater(
    () => import("./chart"),
    ({ drawChart }) => drawChart(place.current as HTMLElement, element, series),
    [element, series],
  );
  const name = element.label || topic.name;
  return (
    <div class="plot">
      {problem && <Problem text={problem} />}
      {missing.value && <Problem text={t("widget.field.none", { name: topic.name, field: missing.value })} />}
      <div part="chart" class="chart" ref={place} role="img" aria-label={t("plot.chart", { name })} />
      {last.value === null ? (
        <p part="status">{t("panel.waiting", { name: topic.name })}</p>
      ) : (
        <ul part="legend" class="legend">
          {fields.map((field, index) => (
            <li key={field} part="entry">
              <span class={`sign sign-${index % 6}`} aria-hidden="true" /> {field}:{" "}
              <span part="value">{format(last.value?.[index] ?? Number.NaN)}</span>
            </li>
          ))}
        </ul>
      )}
      <button
        type="button"
        part="button"
        aria-pressed={element.paused}
        onClick={() => {
          element.paused = !element.paused;
        }}
      >
        {t("plot.pause")}
      </button>
    </div>
  );
}

function format(value: number): string {
  if (!Number.isFinite(value)) return "–";
  return Number.isInteger(value) ? String(value) : value.toPrecision(4);
}

defineElement("rwt-plot", PlotElement);
