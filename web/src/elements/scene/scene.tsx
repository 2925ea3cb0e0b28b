/** `<rwt-scene>` and `<rwt-map>`: the robot and what it sees, in three dimensions or from above. */

import { effect, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { blockText } from "../../forms/commanding";
import { useLater } from "../../forms/later";
import { Problem } from "../../forms/problem";
import { useTexts } from "../../i18n/context";
import { NavigationState } from "../../panels/drive/navigation_state";
import { shortType } from "../../robot/names";
import { Navigation } from "../../robot/navigation";
import type { RobotScene } from "../../scene/scene";
import { flag, text } from "../base/attributes";
import { COMMON, defineElement, RobotElement, type ViewProps } from "../base/element";
import { style } from "./style";

export class SceneElement extends RobotElement {
  static override attributes = {
    ...COMMON,
    /** The topics that are drawn, with blanks between them; by default what can be drawn and is not large. */
    layers: text(),
    /** The frame that stands still; by default the map's. */
    frame: text(),
    /** True if the camera stays with the robot. */
    follow: flag(),
    /** True if there is a button for sending the robot somewhere. */
    goals: flag(),
    /** Origins besides the robot's server that meshes may come from, with blanks between them. */
    meshOrigins: text(),
  };
  static override style = style;
  declare robot: string;
  declare layers: string;
  declare frame: string;
  declare follow: boolean;
  declare goals: boolean;
  declare meshOrigins: string;

  /** True if the camera begins above the robot. */
  readonly fromAbove: boolean = false;
  /** Types that are drawn where no layers are named; null for all. */
  readonly types: ReadonlySet<string> | null = null;

  protected override readonly view = SceneView;

  /** @internal Whether a topic is drawn; null where that is left to the scene. */
  wants(topic: string, type: string): boolean | null {
    const named = this.layers.split(/[\s,]+/).filter((name) => name !== "");
    if (named.length) return named.includes(topic);
    return this.types === null || this.types.has(shortType(type)) ? null : false;
  }
}

export class MapElement extends SceneElement {
  override readonly fromAbove = true;
  override readonly types = new Set([
    "nav_msgs/OccupancyGrid",
    "nav_msgs/Path",
    "sensor_msgs/LaserScan",
    "std_msgs/String",
    "visualization_msgs/InteractiveMarkerUpdate",
  ]);
}

function SceneView({ element, session, stop }: ViewProps<SceneElement>) {
  const t = useTexts();
  const place = useRef<HTMLDivElement>(null);
  const drawn = useSignal<RobotScene | null>(null);
  const navigation = useMemo(() => new Navigation(session), [session]);
  const problem = useLater(
    () => import("../../scene/scene"),
    ({ RobotScene }) => {
      for (const origin of element.meshOrigins.split(/[\s,]+/)) {
        if (URL.canParse(origin)) session.meshOrigins.add(new URL(origin).origin);
      }
      const scene = new RobotScene(session, place.current as HTMLElement);
      scene.fromAbove = element.fromAbove;
      const dark = matchMedia("(prefers-color-scheme: dark)");
      const followDark = () =>
        scene.view.setDark(dark.matches && getComputedStyle(element).colorScheme.includes("dark"));
      followDark();
      dark.addEventListener("change", followDark);
      const endEffects = [
        effect(() => {
          for (const { topic, type, layer } of scene.rows.value) {
            const wanted = element.wants(topic, type);
            if (wanted !== null && wanted !== (layer !== null)) scene.show(topic, wanted);
          }
        }),
        effect(() => {
          if (element.frame) scene.frames.fix(element.frame);
        }),
        effect(() => {
          scene.frames.changed.value;
          if (element.follow !== (scene.followed.peek() !== "") && scene.base) scene.follow(element.follow);
        }),
      ];
      scene.tools.onPlace = (_, where) => {
        const frame = scene.frames.fixed.peek();
        if (session.commands.block.peek()) return;
        navigation.send(where, frame);
        element.tell("goal", { ...where, frame });
      };
      drawn.value = scene;
      return () => {
        for (const each of endEffects) each();
        dark.removeEventListener("change", followDark);
        scene.dispose();
      };
    },
    [element, session, stop, navigation],
  );
  useEffect(() => {
    let under = false;
    return effect(() => {
      const outcome = navigation.progress.value?.outcome;
      if (under && outcome) element.tell("goal-end", { outcome });
      under = outcome === null;
    });
  }, [element, navigation]);
  return (
    <div class="scene">
      {problem && <Problem text={problem} />}
      <div part="view" class="view" ref={place} role="application" aria-label={t("scene.keys")} />
      {element.goals && drawn.value && (
        <Goals {...{ navigation, scene: drawn.value }} blocked={blockText(session, t)} />
      )}
    </div>
  );
}

function Goals(props: { navigation: Navigation; scene: RobotScene; blocked: string }) {
  const { navigation, scene, blocked } = props;
  const t = useTexts();
  const isChosen = scene.tools.chosen.value === "goal";
  if (!navigation.way) return <Problem text={t("goal.none")} />;
  return (
    <div part="goals" class="goals">
      <button
        type="button"
        part="button"
        aria-pressed={isChosen}
        disabled={blocked !== ""}
        title={blocked || undefined}
        onClick={() => scene.tools.choose(isChosen ? "look" : "goal")}
      >
        {t("scene.goal")}
      </button>
      <NavigationState navigation={navigation} />
    </div>
  );
}

defineElement("rwt-scene", SceneElement);
defineElement("rwt-map", MapElement);
