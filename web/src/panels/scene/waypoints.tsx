/** Places that the robot is sent to one after the other: clicked, dragged, reordered, and kept with the layout. */

import { ArrowDown, ArrowUp, X } from "lucide";
import { useEffect, useMemo } from "preact/hooks";
import { BufferGeometry, Group, Line, LineBasicMaterial, Vector3 } from "three";
import { CSS2DObject } from "three/addons/renderers/CSS2DRenderer.js";
import { blockText } from "../../forms/commanding";
import { Icon } from "../../forms/icon";
import { t } from "../../i18n/text";
import type { Place, Waypoint } from "../../robot/navigation";
import { arrow } from "../../scene/layers/poses";
import type { RobotScene } from "../../scene/scene";
import { disposeTree } from "../../scene/view";
import type { PanelContext } from "../registry";

const MOST_WAYPOINTS = 50;
/** Metres from a waypoint within which a press takes it. */
const REACH = 0.35;
const COLOUR = 0x2f8f5b;

export interface WaypointList {
  add(place: Place, frame: string): void;
  /** What moves the waypoint at a point; null where there is none. */
  grab(at: Vector3): ((to: Vector3) => void) | null;
  set(waypoints: readonly Waypoint[]): void;
}

const NONE: readonly Waypoint[] = [];

function waypointsOf({ config }: PanelContext): readonly Waypoint[] {
  return (config.value.waypoints as Waypoint[] | undefined) ?? NONE;
}

export function useWaypoints(context: PanelContext, scene: RobotScene): WaypointList {
  const { config } = context;
  const { frames } = scene;
  return useMemo(() => {
    const current = () => (config.peek().waypoints ?? []) as Waypoint[];
    const set = (waypoints: readonly Waypoint[]) => {
      config.value = { ...config.peek(), waypoints: waypoints.slice(0, MOST_WAYPOINTS) };
    };
    return {
      set,
      add: (place, frame) => set([...current(), { place, frame }]),
      grab: ({ x, y }) => {
        // Those of other frames stay: a drag is in the fixed one.
        const found = current().findIndex(
          ({ place, frame }) => frame === frames.fixed.peek() && Math.hypot(place.x - x, place.y - y) < REACH,
        );
        if (found < 0) return null;
        return (to) =>
          set(
            current().map((each, at) =>
              at === found ? { ...each, place: { ...each.place, x: to.x, y: to.y } } : each,
            ),
          );
      },
    };
  }, [config, frames]);
}

/** The waypoints as a list, and drawn in the scene. */
export function Waypoints(props: { context: PanelContext; scene: RobotScene; waypoints: WaypointList }) {
  const { context, scene, waypoints } = props;
  const all = waypointsOf(context);
  const { navigation, session } = context;
  const { frames, view, tools } = scene;
  const current = navigation.waypoint.value;
  useEffect(() => draw(scene, all), [scene, frames, view, all]);
  if (!all.length && tools.chosen.value !== "waypoint") return null;
  const why = blockText(session, t);
  const isUnderway = current >= 0;
  const swap = (at: number, other: number) => {
    const changed = [...all];
    [changed[at], changed[other]] = [changed[other] as Waypoint, changed[at] as Waypoint];
    waypoints.set(changed);
  };
  return (
    <section class="scene-card waypoints" aria-label={t("scene.waypoints")}>
      <b>{t("scene.waypoints")}</b>
      {all.length === 0 && <p class="faint">{t("scene.waypoints.none")}</p>}
      <ol>
        {all.map(({ place: { x, y, yaw }, frame }, at) => (
          <li
            key={at}
            class={at === current ? "current" : ""}
            aria-current={at === current ? "step" : undefined}
          >
            <span class="grow">
              {at + 1}: {x.toFixed(2)}, {y.toFixed(2)} m, {((yaw * 180) / Math.PI).toFixed(0)}°
              {frame !== frames.fixed.value && <span class="faint"> {frame}</span>}
            </span>
            {(
              [
                ["up", ArrowUp, at > 0, () => swap(at, at - 1)],
                ["down", ArrowDown, at < all.length - 1, () => swap(at, at + 1)],
                ["remove", X, true, () => waypoints.set(all.filter((_, other) => other !== at))],
              ] as const
            ).map(([name, icon, can, press]) => (
              <button
                key={name}
                type="button"
                class="gear"
                disabled={isUnderway || !can}
                aria-label={t(`scene.waypoint.${name}`, { number: at + 1 })}
                onClick={press}
              >
                <Icon of={icon} size={16} />
              </button>
            ))}
          </li>
        ))}
      </ol>
      <div class="row">
        {isUnderway ? (
          <button type="button" onClick={() => navigation.cancel()}>
            {t("goal.cancel")}
          </button>
        ) : (
          <button
            type="submit"
            disabled={!all.length || why !== ""}
            title={why || undefined}
            onClick={() => void navigation.follow(all)}
          >
            {t("scene.waypoints.follow")}
          </button>
        )}
        <button type="button" disabled={isUnderway || !all.length} onClick={() => waypoints.set([])}>
          {t("scene.waypoints.clear")}
        </button>
      </div>
    </section>
  );
}

/** Draw waypoints with their numbers, and a line through them; returns what removes them. */
function draw({ frames, view }: RobotScene, all: readonly Waypoint[]): () => void {
  const drawn = all.map(({ place: { x, y, yaw }, frame }, at) => {
    const holder = new Group();
    holder.position.set(x, y, 0.05);
    const along = arrow(COLOUR, 0.5);
    along.rotation.z = yaw;
    const label = document.createElement("span");
    label.className = "scene-name waypoint";
    label.textContent = String(at + 1);
    holder.add(along, new CSS2DObject(label));
    frames.place(frame).add(holder);
    return holder;
  });
  const [first] = all;
  if (first && all.every(({ frame }) => frame === first.frame)) {
    const points = all.map(({ place: { x, y } }) => new Vector3(x, y, 0.04));
    const line = new Line(
      new BufferGeometry().setFromPoints(points),
      new LineBasicMaterial({ color: COLOUR }),
    );
    const holder = new Group().add(line);
    frames.place(first.frame).add(holder);
    drawn.push(holder);
  }
  view.redraw();
  return () => {
    for (const each of drawn) {
      disposeTree(each);
      each.removeFromParent();
    }
    view.redraw();
  };
}
