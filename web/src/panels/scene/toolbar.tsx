/** Tools of the 3D view. */

import { useSignal } from "@preact/signals";
import {
  ArrowDownToLine,
  Crosshair,
  Flag,
  type IconNode,
  Layers,
  Locate,
  MapPin,
  MousePointer2,
  Move3d,
  Orbit,
  Route,
  Ruler,
} from "lucide";
import { useEffect } from "preact/hooks";
import { blockText } from "../../forms/commanding";
import { IconButton } from "../../forms/icon";
import { Choice } from "../../forms/inputs";
import { Menu } from "../../forms/menu";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import type { Place } from "../../robot/navigation";
import type { RobotScene } from "../../scene/scene";
import type { ToolName } from "../../scene/tools";
import { NavigationState } from "../drive/navigation_state";
import type { PanelContext } from "../registry";
import { Handles } from "./handles";
import { LayerList } from "./layers";
import { SavedViews } from "./views";

const COMMANDS: readonly ToolName[] = ["goal", "pose", "point"];

export function Toolbar({ context, scene }: { context: PanelContext; scene: RobotScene }) {
  const { navigation, session } = context;
  const { tools, frames, axes } = scene;
  const draft = navigation.draft.value;
  useEffect(
    () => (draft ? tools.preview(draft.place, frames.place(draft.frame)) : undefined),
    [tools, frames, draft, tools.chosen.value],
  );
  const following = scene.followed.value !== "";
  const axesShown = useSignal(axes.isShown);
  const why = blockText(session, t);
  frames.changed.value;
  const button = (icon: IconNode, title: string, pressed: boolean | undefined, press: () => void) => (
    <IconButton of={icon} name={title} aria-pressed={pressed} onClick={press} />
  );
  const tool = (name: ToolName, icon: IconNode, title: string, disabled = false) => (
    <IconButton
      of={icon}
      name={title}
      aria-pressed={tools.chosen.value === name}
      disabled={disabled || (COMMANDS.includes(name) && why !== "")}
      title={COMMANDS.includes(name) && why ? why : undefined}
      onClick={() => tools.choose(tools.chosen.peek() === name ? "look" : name)}
    />
  );
  return (
    <div class="scene-tools" role="toolbar" aria-label={t("scene.tools")}>
      <div class="tools">
        {tool("goal", Flag, t("scene.goal"), !navigation.way)}
        {navigation.takesPose && tool("pose", MapPin, t("scene.pose"))}
        {navigation.way?.kind === "action" && tool("waypoint", Route, t("scene.waypoints"))}
        {navigation.takesPoint && tool("point", Crosshair, t("scene.point"))}
        {tool("measure", Ruler, t("scene.measure"))}
        {tool("inspect", MousePointer2, t("scene.inspect"))}
        <hr />
        {button(ArrowDownToLine, t("scene.top"), undefined, () => scene.look(true))}
        {button(Orbit, t("scene.orbit"), undefined, () => scene.look(false))}
        {button(Locate, t("scene.follow"), following, () => scene.follow(!following))}
        {button(Move3d, t("frames.title"), axesShown.value, () => {
          axes.show(!axes.isShown);
          axesShown.value = axes.isShown;
        })}
        <hr />
        <SavedViews context={context} scene={scene} />
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
        {Number.isFinite(tools.measured.value) && <output>{fixed(tools.measured.value, 3)} m</output>}
        <NavigationState navigation={navigation} />
        {tools.chosen.value !== "look" && (
          <p class="faint tool-hint" role="status">
            {t(`scene.tool.${tools.chosen.value}`)} {t("scene.tool.hint")}{" "}
            {tools.cursor.value && t("scene.tool.at", placeText(tools.cursor.value))}
          </p>
        )}
      </div>
    </div>
  );
}

function placeText({ x, y, yaw }: Place): { x: string; y: string; degrees: string } {
  const degrees = (((yaw * 180) / Math.PI) % 360).toFixed(0);
  return { x: x.toFixed(2), y: y.toFixed(2), degrees };
}
