/** The 3D view with everything around it. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { USUAL_AXES } from "../../scene/layers/frame_axes";
import type { LayerSettings } from "../../scene/layers/layer";
import { QUALITIES, type Quality } from "../../scene/quality";
import { RobotScene } from "../../scene/scene";
import type { PanelContext } from "../registry";
import { Details, useDetails } from "./details";
import { MarkerMenu } from "./handles";
import { Toolbar } from "./toolbar";
import { Legends, ViewCube } from "./views";
import { useWaypoints, Waypoints } from "./waypoints";

export function Stage({ context }: { context: PanelContext }) {
  const place = useRef<HTMLDivElement>(null);
  const drawn = useSignal<RobotScene | null>(null);
  const problem = useSignal("");
  const { session, config } = context;
  const quality = qualityOf(context);
  useEffect(() => {
    const host = place.current as HTMLElement;
    const { layers, layerSettings } = config.peek();
    let made: RobotScene;
    try {
      made = new RobotScene(session, host, { ...(layers as Record<string, boolean>) }, quality, {
        ...(layerSettings as Record<string, LayerSettings>),
      });
    } catch (error) {
      problem.value = t("panel.failed", { reason: (error as Error).message });
      return undefined;
    }
    drawn.value = made;
    // For people who write tests and for the curious; nothing of the page uses it.
    Object.assign(host, { robotScene: made });
    return () => {
      drawn.value = null;
      made.dispose();
    };
  }, [session, config, quality, drawn, problem]);
  const scene = drawn.value;
  const view = scene?.view;
  useEffect(() => view?.setVisible(context.visible.value), [view, context.visible.value]);
  useEffect(() => view?.setDark(context.dark.value), [view, context.dark.value]);
  const layers = config.value.layers as Record<string, boolean> | undefined;
  useEffect(() => {
    for (const [topic, shown] of Object.entries(layers ?? {})) scene?.show(topic, shown);
  }, [scene, layers]);
  const settings = config.value.layerSettings as Record<string, LayerSettings> | undefined;
  useEffect(() => {
    for (const [topic, each] of Object.entries(settings ?? {})) scene?.configure(topic, each);
  }, [scene, settings]);
  const axes = config.value.axes as object | undefined;
  useEffect(() => scene?.axes.configure({ ...USUAL_AXES, ...axes }), [scene, axes]);
  return (
    <div class="scene">
      {problem.value && <Problem text={problem.value} />}
      {scene && <Toolbar context={context} scene={scene} />}
      <div class="scene-view" ref={place} role="application" aria-label={t("scene.keys")} />
      {scene && <Around context={context} scene={scene} />}
    </div>
  );
}

/** What lies over the view. */
function Around({ context, scene }: { context: PanelContext; scene: RobotScene }) {
  const details = useDetails(scene);
  const waypoints = useWaypoints(context, scene);
  const { tools, frames } = scene;
  const { navigation } = context;
  useEffect(() => {
    tools.onPlace = (tool, where) => {
      const frame = frames.fixed.peek();
      if (tool === "pose") navigation.setPose(where, frame);
      else if (tool === "point") navigation.publishPoint(where, frame);
      else if (tool === "inspect") details.inspect(where);
      else if (tool === "waypoint") waypoints.add(where, frame);
      else void navigation.send(where, frame);
    };
    tools.onGrab = (at) => waypoints.grab(at);
  }, [tools, frames, navigation, details, waypoints]);
  return (
    <>
      <ViewCube scene={scene} />
      <MarkerMenu scene={scene} />
      <div class="scene-foot">
        <div class="scene-left">
          <Problems scene={scene} />
          <Legends scene={scene} />
        </div>
        <Waypoints context={context} scene={scene} waypoints={waypoints} />
        <Details scene={scene} details={details} />
      </div>
    </>
  );
}

/** Draw quality set in the panel. */
function qualityOf({ config }: PanelContext): Quality {
  return QUALITIES.find((each) => each === config.value.quality) ?? "auto";
}

/** Errors of topics that cannot be drawn. */
function Problems({ scene }: { scene: RobotScene }) {
  const problems = scene.rows.value.filter(({ layer }) => layer?.problem.value);
  const { frames } = scene;
  const lost = frames.unreachable.value;
  if (!problems.length && !lost.length) return null;
  return (
    <div class="scene-problems">
      {lost.map((frame) => (
        <p key={frame} class="scene-lost" role="status">
          {frames.fixed.value
            ? t("scene.lost", { frame: frame || "–", fixed: frames.fixed.value })
            : t("scene.lost.all", { frame: frame || "–" })}{" "}
          {frame && (
            <button type="button" onClick={() => frames.fix(frame)}>
              {t("scene.lost.use", { frame })}
            </button>
          )}
        </p>
      ))}
      {problems.map(({ topic, layer }) => (
        <Problem key={topic} text={`${topic}: ${layer?.problem.value}`} />
      ))}
    </div>
  );
}
