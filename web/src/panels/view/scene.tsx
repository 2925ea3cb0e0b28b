/** The 3D scene: the robot and what it sees, with tools to send it somewhere. Its library is loaded when it opens. */

import { useSignal } from "@preact/signals";
import {
  ArrowDownToLine,
  Flag,
  Grab,
  type IconNode,
  Layers,
  Locate,
  MapPin,
  Move3d,
  Orbit,
  Ruler,
} from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { blockText } from "../../forms/commanding";
import { Icon } from "../../forms/icon";
import { Check, Choice } from "../../forms/inputs";
import { useLater } from "../../forms/later";
import { Menu } from "../../forms/menu";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { shortType } from "../../robot/names";
import type { Place } from "../../robot/navigation";
import type { Handle } from "../../scene/layers/handles";
import { QUALITIES, type Quality } from "../../scene/quality";
import type { RobotScene } from "../../scene/scene";
import type { ToolName } from "../../scene/tools";
import { componentPanel } from "../component";
import { NavigationState } from "../drive/navigation_state";
import type { PanelContext, PanelKind } from "../registry";

/** Types that are worth a scene; the scene itself draws more. */
const TYPES = [
  "nav_msgs/OccupancyGrid",
  "sensor_msgs/LaserScan",
  "sensor_msgs/PointCloud2",
  "nav_msgs/Odometry",
];

const MOST_HANDLES = 100;

export const scene: PanelKind = {
  name: "scene",
  title: "scene.title",
  supportedTypes: TYPES,
  opens: (session) =>
    session.topicsOf(...TYPES).length > 0 || session.graph.value.topics.has("/robot_description"),
  place: "main",
  init: componentPanel(ScenePanel),
};

function ScenePanel({ context }: { context: PanelContext }) {
  const place = useRef<HTMLDivElement>(null);
  const drawn = useSignal<RobotScene | null>(null);
  const { session, config } = context;
  const quality = qualityOf(context);
  const problem = useLater(
    () => import("../../scene/scene"),
    ({ RobotScene }) => {
      const host = place.current as HTMLElement;
      const layers = { ...(config.peek().layers as Record<string, boolean>) };
      const made = new RobotScene(session, host, layers, quality);
      drawn.value = made;
      // For people who write tests and for the curious; nothing of the page uses it.
      Object.assign(host, { robotScene: made });
      return () => {
        drawn.value = null;
        made.dispose();
      };
    },
    [session, config, quality],
  );
  const view = drawn.value?.view;
  useEffect(() => view?.setVisible(context.visible.value), [view, context.visible.value]);
  useEffect(() => view?.setDark(context.dark.value), [view, context.dark.value]);
  const layers = config.value.layers as Record<string, boolean> | undefined;
  useEffect(() => {
    for (const [topic, shown] of Object.entries(layers ?? {})) drawn.value?.show(topic, shown);
  }, [drawn.value, layers]);
  return (
    <div class="scene">
      {problem && <Problem text={problem} />}
      {drawn.value && <Toolbar context={context} scene={drawn.value} />}
      <div class="scene-view" ref={place} role="application" aria-label={t("scene.keys")} />
      {drawn.value && <MarkerMenu scene={drawn.value} />}
      {drawn.value && <Problems scene={drawn.value} />}
    </div>
  );
}

/** Draw quality set in the panel. */
function qualityOf({ config }: PanelContext): Quality {
  return QUALITIES.find((each) => each === config.value.quality) ?? "auto";
}

function Toolbar({ context, scene }: { context: PanelContext; scene: RobotScene }) {
  const { navigation, session } = context;
  const { tools, frames, axes } = scene;
  const draft = navigation.draft.value;
  useEffect(
    () => (draft ? tools.preview(draft.place, frames.place(draft.frame)) : undefined),
    [tools, frames, draft, tools.chosen.value],
  );
  const following = scene.followed.value !== "";
  const axesShown = useSignal(axes.isShown);
  useEffect(() => {
    tools.onPlace = (tool, where) => {
      const frame = frames.fixed.peek();
      if (tool === "pose") navigation.setPose(where, frame);
      else navigation.send(where, frame);
    };
  }, [tools, frames, navigation]);
  const why = blockText(session, t);
  frames.changed.value;
  const tool = (name: ToolName, icon: IconNode, title: string, disabled: boolean) => (
    <button
      type="button"
      aria-pressed={tools.chosen.value === name}
      disabled={disabled}
      title={(name === "goal" || name === "pose") && why ? why : undefined}
      onClick={() => tools.choose(tools.chosen.peek() === name ? "look" : name)}
    >
      <Icon of={icon} />
      <span class="words">{title}</span>
    </button>
  );
  return (
    <div class="scene-tools" role="toolbar" aria-label={t("scene.tools")}>
      <div class="tools">
        {tool("goal", Flag, t("scene.goal"), !navigation.way || why !== "")}
        {navigation.takesPose && tool("pose", MapPin, t("scene.pose"), why !== "")}
        {tool("measure", Ruler, t("scene.measure"), false)}
        <hr />
        <button type="button" onClick={() => scene.look(true)}>
          <Icon of={ArrowDownToLine} />
          <span class="words">{t("scene.top")}</span>
        </button>
        <button type="button" onClick={() => scene.look(false)}>
          <Icon of={Orbit} />
          <span class="words">{t("scene.orbit")}</span>
        </button>
        <button type="button" aria-pressed={following} onClick={() => scene.follow(!following)}>
          <Icon of={Locate} />
          <span class="words">{t("scene.follow")}</span>
        </button>
        <button
          type="button"
          aria-pressed={axesShown.value}
          onClick={() => {
            axes.show(!axes.isShown);
            axesShown.value = axes.isShown;
          }}
        >
          <Icon of={Move3d} />
          <span class="words">{t("scene.frames")}</span>
        </button>
        <hr />
        <Menu label={t("scene.layers")} icon={Layers}>
          {() => <LayerList context={context} scene={scene} />}
        </Menu>
        <Handles scene={scene} />
      </div>
      <div class="where">
        <Choice
          label={t("scene.fixed")}
          quiet
          chosen={frames.fixed.value}
          options={
            frames.names.includes(frames.fixed.value) ? frames.names : [frames.fixed.value, ...frames.names]
          }
          onChoose={(frame) => frames.fix(frame)}
        />
        {Number.isFinite(tools.measured.value) && <output>{tools.measured.value.toFixed(3)} m</output>}
        <NavigationState navigation={navigation} />
        {tools.chosen.value !== "look" && (
          <p class="faint tool-hint" role="status">
            {t("scene.tool.hint")} {tools.cursor.value && t("scene.tool.at", placeText(tools.cursor.value))}
          </p>
        )}
      </div>
    </div>
  );
}

/** A box for each topic that can be drawn, and how finely all is. */
function LayerList({ context, scene }: { context: PanelContext; scene: RobotScene }) {
  const { config } = context;
  const chosen = config.value.layers as Record<string, boolean> | undefined;
  return (
    <>
      <ul>
        {scene.rows.value.map(({ topic, type, layer }) => (
          <li key={topic}>
            <Check
              // The scene follows a choice only after this render.
              checked={chosen?.[topic] ?? layer !== null}
              onChange={(checked) => {
                const layers = config.peek().layers as Record<string, boolean> | undefined;
                config.value = { ...config.peek(), layers: { ...layers, [topic]: checked } };
              }}
            >
              {topic} <span class="faint">{shortType(type).split("/")[1]}</span>
            </Check>
          </li>
        ))}
      </ul>
      <Choice
        label={t("scene.quality")}
        chosen={qualityOf(context)}
        options={QUALITIES.map((each) => [each, t(`scene.quality.${each}`)])}
        onChoose={(quality) => {
          config.value = { ...config.value, quality };
        }}
      />
    </>
  );
}

function placeText({ x, y, yaw }: Place): { x: string; y: string; degrees: string } {
  const degrees = (((yaw * 180) / Math.PI) % 360).toFixed(0);
  return { x: x.toFixed(2), y: y.toFixed(2), degrees };
}

/** The controls of interactive markers by name, for the keyboard. */
function Handles({ scene }: { scene: RobotScene }) {
  const all = scene.rows.value.flatMap(({ topic, layer }) =>
    (layer?.handles.value ?? []).map((handle) => ({ ...handle, id: `${topic} ${handle.id}` })),
  );
  if (!all.length) return null;
  return (
    <Menu label={t("scene.handles")} icon={Grab}>
      {() => (
        <>
          <p class="faint">{t("scene.handles.hint")}</p>
          <ul>
            {all.slice(0, MOST_HANDLES).map((handle) => (
              <li key={handle.id}>
                <HandleButton handle={handle} />
              </li>
            ))}
          </ul>
        </>
      )}
    </Menu>
  );
}

/** A control of a marker: arrow keys take and move it, Enter lets it go there, Escape and leaving it put it back. */
function HandleButton({ handle }: { handle: Handle }) {
  const taken = useRef(false);
  const release = (keep: boolean) => {
    if (taken.current) handle.release(keep);
    taken.current = false;
  };
  useEffect(() => () => release(false), []);
  return (
    <button
      type="button"
      onKeyDown={(event) => {
        const { key } = event;
        if (taken.current && (key === "Enter" || key === "Escape")) {
          release(key === "Enter");
        } else if (handle.key(key, event.shiftKey)) {
          taken.current = true;
        } else {
          return;
        }
        event.preventDefault();
        event.stopPropagation();
      }}
      onBlur={() => release(false)}
      onClick={(event) => {
        const { left, bottom } = event.currentTarget.getBoundingClientRect();
        handle.press({ x: left, y: bottom });
      }}
    >
      {handle.marker} · {handle.control}{" "}
      <span class="faint">{t(`scene.handle.${handle.moves ?? "press"}`)}</span>
    </button>
  );
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

/** The menu of an interactive marker. */
function MarkerMenu({ scene }: { scene: RobotScene }) {
  const list = useRef<HTMLUListElement>(null);
  const request = scene.menu.value;
  useEffect(() => {
    if (!request) return undefined;
    list.current?.style.setProperty("left", `${request.x}px`);
    list.current?.style.setProperty("top", `${request.y}px`);
    list.current?.querySelector("button")?.focus();
    const away = (event: PointerEvent) => {
      if (!list.current?.contains(event.target as Node)) scene.menu.value = null;
    };
    addEventListener("pointerdown", away, { capture: true });
    return () => removeEventListener("pointerdown", away, { capture: true });
  }, [request, scene]);
  if (!request) return null;
  const close = () => {
    scene.menu.value = null;
    // The keyboard is not lost with the menu.
    scene.view.canvas.focus({ preventScroll: true });
  };
  const depth = (id: number): number => {
    const parent = request.entries.find((entry) => entry.id === id)?.parent_id ?? 0;
    return parent && parent !== id ? 1 + Math.min(depth(parent), 5) : 0;
  };
  return (
    <ul
      class="menu marker-menu"
      ref={list}
      onKeyDown={(event) => {
        if (event.key !== "Escape") return;
        event.stopPropagation();
        close();
      }}
    >
      {request.entries.map(({ id, title }) => (
        <li key={id}>
          <button
            type="button"
            class={`depth-${depth(id)}`}
            onClick={() => {
              close();
              request.choose(id);
            }}
          >
            {title}
          </button>
        </li>
      ))}
    </ul>
  );
}
