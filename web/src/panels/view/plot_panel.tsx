/** Numbers over time, or one against another: derived series, statistics, reference lines, zoom and export. */

import { fixed } from "../../i18n/formats";
import "uplot/dist/uPlot.min.css";
import { type Signal, signal, useSignal } from "@preact/signals";
import {
  ChevronsLeft,
  ChevronsRight,
  Download,
  Link,
  Pause,
  Play,
  SlidersHorizontal,
  X,
  ZoomIn,
  ZoomOut,
} from "lucide";
import type { ButtonHTMLAttributes, ComponentChildren } from "preact";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { Icon, IconButton } from "../../forms/icon";
import { Check, Choice } from "../../forms/inputs";
import { useLater } from "../../forms/later";
import { Problem } from "../../forms/problem";
import { type TextKey, t } from "../../i18n/text";
import { Formula, formulaProblem } from "../../robot/formula";
import { saveAs } from "../component";
import type { PanelContext } from "../registry";
import { AddField, type Field } from "./add_field";
import type { Span } from "./plot_chart";
import { Series } from "./series";
import { drawInTurn } from "./turns";

/** One line of the plot. */
interface Line extends Field {
  /** On the axis at the right. */
  right?: boolean;
}

/** Settings of a plot. */
interface Settings {
  lines: Line[];
  /** Field of the horizontal axis; null for time. */
  x: Field | null;
  /** Reference lines on the left axis. */
  marks: number[];
  /** Seconds that are kept. */
  seconds: number;
  statistics: boolean;
  /** True if zooming one plot zooms all linked ones. */
  linked: boolean;
}

/** Milliseconds between two updates of the table. */
const TABLE = 250;
const COLOURS = 4;
const MOST_LINES = 2 * COLOURS;
const MOST_MARKS = 16;
const SECONDS = [10, 60, 300, 900, 3600];
/** Seconds that are shown at least. */
const LEAST_SPAN = 0.02;

/** Time that all plots point at, and the part that linked ones show. */
const cursor: Signal<number | null> = signal(null);
const linkedSpan: Signal<Span | null> = signal(null);

function isField(value: unknown): value is Line {
  const { topic, path } = (value ?? {}) as Partial<Line>;
  return typeof topic === "string" && typeof path === "string" && formulaProblem(path) === "";
}

/** Settings as a layout has them; what is missing, or of another kind, is as usual. */
export function plotSettings(value: Record<string, unknown>, usual: readonly Line[]): Settings {
  const lines = Array.isArray(value.lines) ? value.lines.filter(isField).slice(0, MOST_LINES) : [...usual];
  const marks = Array.isArray(value.marks) ? value.marks.filter(Number.isFinite).slice(0, MOST_MARKS) : [];
  const seconds = Number(value.seconds);
  return {
    lines,
    marks,
    x: isField(value.x) ? value.x : null,
    seconds: seconds >= 1 && seconds <= 3600 ? seconds : 60,
    statistics: value.statistics === true,
    linked: value.linked !== false,
  };
}

/** Default series: the speed of the robot. */
function usualLines({ session }: PanelContext): Line[] {
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

const nameOf = ({ topic, path }: Field) => `${topic} ${path}`;

export function Panel({ context }: { context: PanelContext }) {
  const { session, config, visible } = context;
  const settings = plotSettings(config.value, usualLines(context));
  const { lines, x, linked, seconds } = settings;
  const paused = useSignal(false);
  const own = useSignal<Span | null>(null);
  const span = linked ? linkedSpan : own;
  const stands = paused.value || span.value !== null;
  const standing = useRef(stands);
  standing.current = stands;
  const tick = useSignal(0);
  const optional = useSignal(false);
  const fields = x ? [x, ...lines] : lines;
  const key = JSON.stringify(fields.map(nameOf));
  const kept = useRef(new Map<string, Series>());
  // A field that stays keeps its values when others come and go.
  const series = useMemo(() => {
    const next = new Map(
      fields.map((field) => [nameOf(field), kept.current.get(nameOf(field)) ?? new Series()]),
    );
    kept.current = next;
    return next;
  }, [key]);
  for (const each of series.values()) each.keep(seconds);
  const isVisible = visible.value;
  useEffect(() => {
    if (!isVisible) return undefined;
    const ends = fields.map((field) => {
      const formula = new Formula(field.path);
      const values = series.get(nameOf(field));
      return session.subscribe(field.topic, session.graph.peek().topics.get(field.topic) ?? "", (message) => {
        // A recording says when its messages were received.
        const time = Number(message.$time ?? Date.now() / 1000);
        const value = formula.numberOf(message, time);
        if (!standing.current) values?.push(time, value);
      });
    });
    return () => {
      for (const end of ends) end();
    };
  }, [session, key, isVisible, series]);
  useEffect(() => {
    if (!isVisible || stands) return undefined;
    const timer = setInterval(() => tick.value++, TABLE);
    return () => clearInterval(timer);
  }, [isVisible, stands, tick]);
  const change = (next: Partial<Settings>) => {
    config.value = { ...config.value, ...next };
  };
  const of = (field: Field) => series.get(nameOf(field)) as Series;
  const whole = (): Span => {
    const spans = lines.map((line) => of(line).span).filter((each) => each !== null);
    return [Math.min(...spans.map(([from]) => from)), Math.max(...spans.map(([, until]) => until))];
  };
  /** Show another part of what there is: around its middle, or beside it. */
  const show = (share: number, aside: number) => {
    const all = whole();
    if (all[1] > all[0]) span.value = partOf(span.value ?? all, all, share, aside);
  };
  return (
    <div class="plot">
      <div class="plot-table">
        <Table {...{ settings, of, span, tick, change }} />
        {lines.length < MOST_LINES && (
          <AddField context={context} onAdd={(field) => change({ lines: [...lines, field] })} />
        )}
        {optional.value && <Options context={context} settings={settings} change={change} />}
      </div>
      <div class="plot-main">
        <div class="plot-tools" role="toolbar" aria-label={t("plot.tools")}>
          {span.value && (
            <>
              <output>{t("plot.span", { seconds: fixed(span.value[1] - span.value[0], 2) })}</output>
              <button
                type="button"
                onClick={() => {
                  span.value = null;
                }}
              >
                {t("plot.all")}
              </button>
            </>
          )}
          <Tool icon={ZoomOut} name="plot.zoom.out" onClick={() => show(2, 0)} />
          <Tool icon={ZoomIn} name="plot.zoom.in" onClick={() => show(0.5, 0)} />
          <Tool icon={ChevronsLeft} name="plot.earlier" onClick={() => show(1, -0.5)} />
          <Tool icon={ChevronsRight} name="plot.later" onClick={() => show(1, 0.5)} />
          <Tool
            icon={Link}
            name="plot.linked"
            aria-pressed={linked}
            onClick={() => change({ linked: !linked })}
          />
          <Tool
            icon={stands ? Play : Pause}
            name="plot.pause"
            aria-pressed={stands}
            onClick={() => {
              paused.value = !stands;
              if (stands) span.value = null;
            }}
          />
          <Tool icon={Download} name="plot.export" onClick={() => exportCsv(lines, lines.map(of))} />
          <Tool
            icon={SlidersHorizontal}
            name="plot.settings"
            aria-pressed={optional.value}
            onClick={() => {
              optional.value = !optional.value;
            }}
          />
        </div>
        {lines.length === 0 && <p class="blank">{t("plot.choose")}</p>}
        <Chart
          {...{ settings, of, span, stands }}
          visible={isVisible}
          dark={context.dark.value}
          onZoom={(part) => {
            span.value = part;
          }}
        />
      </div>
    </div>
  );
}

function Tool({ icon, name, ...rest }: { icon: typeof Play; name: TextKey } & ButtonHTMLAttributes) {
  return <IconButton of={icon} name={t(name)} size={16} class="tip-below" {...rest} />;
}

/**
 * Another part of a whole: a share of the part that was shown around its middle, and moved by a share of its length;
 * null for all of it.
 */
export function partOf(shown: Span, whole: Span, share: number, aside: number): Span | null {
  const length = Math.max((shown[1] - shown[0]) * share, LEAST_SPAN);
  if (length >= whole[1] - whole[0]) return null;
  const middle = (shown[0] + shown[1]) / 2 + aside * (shown[1] - shown[0]);
  const from = Math.min(Math.max(middle - length / 2, whole[0]), whole[1] - length);
  return [from, from + length];
}

/** Place of a line's colour, and whether it is dashed. */
const look = (at: number) => ({ colour: (at % COLOURS) + 1, dashed: at >= COLOURS });

function Table(props: {
  settings: Settings;
  of: (field: Field) => Series;
  span: Signal<Span | null>;
  tick: Signal<number>;
  change: (next: Partial<Settings>) => void;
}) {
  const { settings, of, span, tick, change } = props;
  const { lines, statistics } = settings;
  tick.value;
  const number = (value: number) => (Number.isFinite(value) ? value.toPrecision(3).replace("-", "−") : "–");
  const [from, until] = span.value ?? [Number.NEGATIVE_INFINITY, Number.POSITIVE_INFINITY];
  if (!lines.length) return null;
  return (
    <table>
      <thead>
        <tr>
          <th scope="col">{t("plot.field")}</th>
          <th scope="col">{cursor.value === null ? t("plot.now") : t("plot.at_cursor")}</th>
          <th scope="col">{t("plot.extent")}</th>
          {statistics && (
            <>
              <th scope="col">{t("plot.mean")}</th>
              <th scope="col">{t("plot.deviation")}</th>
              <th scope="col">{t("values.title")}</th>
            </>
          )}
          <th>
            <span class="hidden">{t("plot.settings")}</span>
          </th>
        </tr>
      </thead>
      <tbody>
        {lines.map((line, at) => {
          const { colour, dashed } = look(at);
          const values = of(line);
          const [least, most] = values.extent(from, until);
          const all = statistics ? values.statistics(from, until) : null;
          const name = nameOf(line);
          return (
            <tr key={name}>
              <th scope="row" title={name}>
                <span class={`plot-mark p${colour} ${dashed ? "dashed" : ""}`} aria-hidden="true" />
                {line.topic}
                <small>{line.path}</small>
              </th>
              <td class="number now">
                {number(cursor.value === null ? values.last : values.at(cursor.value))}
              </td>
              <td class="number faint">{least <= most ? `${number(least)} … ${number(most)}` : "–"}</td>
              {all && (
                <>
                  <td class="number">{number(all.mean)}</td>
                  <td class="number">{number(all.deviation)}</td>
                  <td class="number">{all.count}</td>
                </>
              )}
              <td class="plot-row">
                <button
                  type="button"
                  aria-pressed={line.right ?? false}
                  aria-label={t("plot.right", { name })}
                  title={t("plot.right", { name })}
                  onClick={() =>
                    change({
                      lines: lines.map((each) => (each === line ? { ...each, right: !each.right } : each)),
                    })
                  }
                >
                  ⇥
                </button>
                <button
                  type="button"
                  aria-label={t("form.remove", { name })}
                  onClick={() => change({ lines: lines.filter((each) => each !== line) })}
                >
                  <Icon of={X} size={14} />
                </button>
              </td>
            </tr>
          );
        })}
      </tbody>
    </table>
  );
}

function Row({ children }: { children: ComponentChildren }) {
  return <div class="plot-option">{children}</div>;
}

function Options(props: {
  context: PanelContext;
  settings: Settings;
  change: (next: Partial<Settings>) => void;
}) {
  const { context, settings, change } = props;
  const { x, marks, seconds, statistics } = settings;
  const mark = useSignal("");
  const wanted = Number(mark.value);
  return (
    <>
      <Row>
        <Choice
          label={t("plot.keep")}
          chosen={String(seconds)}
          options={[...new Set([...SECONDS, seconds])]
            .sort((one, other) => one - other)
            .map((each) => [String(each), each < 60 ? `${each} s` : `${each / 60} min`])}
          onChoose={(value) => change({ seconds: Number(value) })}
        />
      </Row>
      <Row>
        <Check checked={statistics} onChange={(checked) => change({ statistics: checked })}>
          {t("plot.statistics")}
        </Check>
      </Row>
      <h2>{t("plot.marks")}</h2>
      {marks.map((each) => (
        <Row key={each}>
          <span class="grow">{each}</span>
          <button
            type="button"
            aria-label={t("form.remove", { name: String(each) })}
            onClick={() => change({ marks: marks.filter((other) => other !== each) })}
          >
            <Icon of={X} size={14} />
          </button>
        </Row>
      ))}
      <form
        class="plot-option"
        onSubmit={(event) => {
          event.preventDefault();
          if (mark.value.trim() === "" || !Number.isFinite(wanted) || marks.length >= MOST_MARKS) return;
          change({ marks: [...new Set([...marks, wanted])] });
          mark.value = "";
        }}
      >
        <label class="grow">
          <span class="hidden">{t("plot.marks")}</span>
          <input
            type="text"
            inputMode="decimal"
            placeholder={t("plot.mark")}
            value={mark.value}
            onInput={(event) => {
              mark.value = event.currentTarget.value;
            }}
          />
        </label>
        <button type="submit" disabled={mark.value.trim() === "" || !Number.isFinite(wanted)}>
          {t("plot.add")}
        </button>
      </form>
      <h2>{t("plot.x")}</h2>
      <Row>
        <span class="grow">{x ? nameOf(x) : t("plot.time")}</span>
        {x && (
          <button type="button" onClick={() => change({ x: null })}>
            {t("plot.time")}
          </button>
        )}
      </Row>
      <AddField context={context} name={t("plot.use")} onAdd={(field) => change({ x: field })} />
    </>
  );
}

interface ChartProps {
  settings: Settings;
  of: (field: Field) => Series;
  span: Signal<Span | null>;
  stands: boolean;
  visible: boolean;
  dark: boolean;
  onZoom: (span: Span | null) => void;
}

function Chart({ settings, of, span, stands, visible, dark, onZoom }: ChartProps) {
  const { lines, x, marks } = settings;
  const place = useRef<HTMLDivElement>(null);
  const chart = useRef<{ redraw(): void } | null>(null);
  const problem = useLater(
    () => import("./plot_chart"),
    ({ drawPlot }) => {
      const drawn = drawPlot(place.current as HTMLElement, {
        curves: lines.map((line, at) => ({ series: of(line), right: line.right ?? false, ...look(at) })),
        x: x && of(x),
        marks,
        span,
        cursor,
        onSelect: onZoom,
      });
      chart.current = drawn;
      return () => {
        drawn.end();
        chart.current = null;
      };
    },
    [JSON.stringify({ lines, x, marks }), span, dark],
  );
  const shown = span.value;
  useEffect(() => {
    if (!visible) return undefined;
    chart.current?.redraw();
    return stands ? undefined : drawInTurn(() => chart.current?.redraw());
  }, [visible, stands, shown]);
  const values = lines.map((line) => of(line));
  const spans = values.map((each) => each.span).filter((each) => each !== null);
  const from = shown?.[0] ?? Math.min(...spans.map(([first]) => first));
  const until = shown?.[1] ?? Math.max(...spans.map(([, last]) => last));
  const at = cursor.value ?? until;
  const key = (event: KeyboardEvent) => {
    const step = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
    if (!step || !(until > from)) return;
    event.preventDefault();
    cursor.value = Math.min(until, Math.max(from, at + step * (until - from)));
  };
  const say = (value: number) => (Number.isFinite(value) ? Number(value.toPrecision(4)) : "–");
  const name = lines.map(nameOf).join(", ");
  return (
    <>
      {problem && <Problem text={problem} />}
      <div
        class="plot-chart"
        ref={place}
        role="slider"
        tabIndex={0}
        aria-label={t("plot.chart", { name })}
        aria-valuemin={0}
        aria-valuemax={Number.isFinite(until - from) ? until - from : 0}
        aria-valuenow={Number.isFinite(at - from) ? at - from : 0}
        aria-valuetext={lines.map((line) => `${nameOf(line)}: ${say(of(line).at(at))}`).join(", ")}
        onKeyDown={key}
        onBlur={() => {
          cursor.value = null;
        }}
      />
    </>
  );
}

function exportCsv(lines: readonly Line[], series: Series[]): void {
  const quote = (text: string) => `"${text.replaceAll('"', '""')}"`;
  const [times = [], ...values] = Series.together(series);
  const head = ["time", ...lines.map((line) => quote(nameOf(line)))].join(",");
  const rows = Array.from(times, (time, at) =>
    [(time as number).toFixed(6), ...values.map((each) => each[at] ?? "")].join(","),
  );
  saveAs(new Blob([`${[head, ...rows].join("\n")}\n`], { type: "text/csv" }), "plot.csv");
}
