/** Where the robot is by satellite: its track on a grid, without any map of others. */

import { useSignal } from "@preact/signals";
import { Eraser, Locate, Maximize, Minus, Plus } from "lucide";
import { useId, useRef } from "preact/hooks";
import { Icon } from "../../forms/icon";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { type Fix, fixOf, type Point, Track } from "../../robot/fixes";
import type { Message } from "../../robot/subscriptions";
import { Needs, TopicChoice, useMessages } from "../component";
import type { PanelContext } from "../registry";
import { position } from "./position";

/** Milliseconds between two messages. */
const THROTTLE = 200;
/** Metres that are shown at least and at most. */
const LEAST_SPAN = 10;
const MOST_SPAN = 1e6;
const ZOOM = 2;
/** Lines of the grid in the shown part, about. */
const LINES = 5;

export function Panel({ context }: { context: PanelContext }) {
  const { session, config } = context;
  const topics = session
    .topicsOf(...position.supportedTypes)
    .filter((topic) => session.may("subscribe", topic));
  const topic = String(config.value.topic ?? topics[0] ?? "");
  if (!topic) return <Needs kind={position} />;
  return (
    <div class="position">
      {topics.length > 1 && <TopicChoice context={context} topics={topics} chosen={topic} />}
      <Tracked key={topic} context={context} topic={topic} />
    </div>
  );
}

function Tracked({ context, topic }: { context: PanelContext; topic: string }) {
  const { session, visible, config } = context;
  const track = useRef(new Track());
  const here = useSignal<Point>([0, 0]);
  /** Undefined before the first message, null while the receiver has no position. */
  const fix = useSignal<Fix | null | undefined>(undefined);
  const take = (message: Message) => {
    const next = fixOf(message);
    if (next) here.value = track.current.add(next);
    fix.value = next;
  };
  useMessages(session, topic, take, { throttle: THROTTLE, isOn: visible.value });
  if (fix.value === undefined) return <p class="faint">{t("panel.waiting", { name: topic })}</p>;
  const { points, length } = track.current;
  const whole = extent(points);
  const span = Number(config.value.span) || 0;
  const zoom = (factor: number) => {
    const wanted = (span || whole.span) * factor;
    config.value = { ...config.value, span: Math.min(Math.max(wanted, LEAST_SPAN), MOST_SPAN) };
  };
  const act = (icon: typeof Plus, name: string, onClick: () => void, pressed?: boolean) => (
    <button type="button" title={name} aria-label={name} aria-pressed={pressed} onClick={onClick}>
      <Icon of={icon} size={16} />
    </button>
  );
  return (
    <>
      <div class="row">
        {act(Maximize, t("position.whole"), () => (config.value = { ...config.value, span: 0 }), !span)}
        {act(Locate, t("position.follow"), () => zoom(1), span > 0)}
        {act(Minus, t("position.out"), () => zoom(ZOOM))}
        {act(Plus, t("position.in"), () => zoom(1 / ZOOM))}
        {act(Eraser, t("position.clear"), () => {
          track.current = new Track();
          if (fix.value) here.value = track.current.add(fix.value);
        })}
      </div>
      <Plane
        points={points}
        here={here.value}
        radius={fix.value?.radius ?? 0}
        centre={span ? here.value : whole.centre}
        span={span || whole.span}
        name={t("position.track", { metres: fixed(length, 0) })}
      />
      <p class="number" role="status">
        {fix.value ? described(fix.value) : t("position.none")}
      </p>
    </>
  );
}

/** The square that all points fit into. */
function extent(points: readonly Point[]): { centre: Point; span: number } {
  const range = (axis: 0 | 1) => {
    let [least, most] = [Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
    for (const point of points) {
      least = Math.min(least, point[axis]);
      most = Math.max(most, point[axis]);
    }
    return most >= least ? [(least + most) / 2, most - least] : [0, 0];
  };
  const [[east, width], [north, height]] = [range(0), range(1)] as [[number, number], [number, number]];
  return { centre: [east, north], span: Math.max(LEAST_SPAN, 1.2 * width, 1.2 * height) };
}

/** The number of the series 1, 2, 5, 10, … that is next to a number from below. */
export function roundedStep(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  return power * (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1);
}

function described({ latitude, longitude, altitude, radius }: Fix): string {
  const degrees = (value: number, [positive, negative]: readonly [string, string]) =>
    `${fixed(Math.abs(value), 6)}° ${value < 0 ? negative : positive}`;
  const parts = [`${degrees(latitude, ["N", "S"])}, ${degrees(longitude, ["E", "W"])}`];
  if (altitude !== null) parts.push(t("position.altitude", { metres: fixed(altitude, 1) }));
  if (radius !== null) parts.push(`± ${fixed(radius, 1)} m`);
  return parts.join(" · ");
}

/** North is up; the view shows at least `span` metres. */
function Plane(props: {
  points: readonly Point[];
  here: Point;
  radius: number;
  centre: Point;
  span: number;
  name: string;
}) {
  const { points, here, radius, centre, span, name } = props;
  const id = useId();
  const step = roundedStep(span / LINES);
  const [x, y] = [centre[0], -centre[1]];
  return (
    <figure class="plane">
      <svg viewBox={`${x - span / 2} ${y - span / 2} ${span} ${span}`} role="img" aria-label={name}>
        <pattern id={id} width={step} height={step} patternUnits="userSpaceOnUse">
          <path class="grid" d={`M ${step} 0 H 0 V ${step}`} vector-effect="non-scaling-stroke" />
        </pattern>
        <rect x={x - 5 * span} y={y - 5 * span} width={10 * span} height={10 * span} fill={`url(#${id})`} />
        <polyline
          points={points.map(([east, north]) => `${east.toFixed(2)},${(-north).toFixed(2)}`).join(" ")}
          vector-effect="non-scaling-stroke"
        />
        {points.length > 0 && (
          <>
            <circle class="accuracy" cx={here[0]} cy={-here[1]} r={radius} />
            <circle class="here" cx={here[0]} cy={-here[1]} r={span / 60} />
          </>
        )}
      </svg>
      <figcaption>{t("position.grid", { metres: step })}</figcaption>
    </figure>
  );
}
