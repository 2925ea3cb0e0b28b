/** Sending the robot somewhere by numbers and buttons: what the scene does with the mouse, for everybody. */

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useId, useRef } from "preact/hooks";
import { Commanding } from "../../forms/commanding";
import { Choice } from "../../forms/inputs";
import { inWords, loadLater, type Trouble } from "../../forms/later";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import type { Place } from "../../robot/navigation";
import type { Message } from "../../robot/subscriptions";
import type { Frames } from "../../scene/frames";
import { componentPanel, useMessages } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { NavigationState } from "./navigation_state";

/** Distance in metres and angle in radians by which one press moves the goal. */
const STEPS = [0.1, 0.5, 2];
const TURN = Math.PI / 8;
/** Frames that a goal is usually said in, and the one of them that stays where it is. */
const FRAMES = ["map", "odom", "base_link"];
const MAP = "map";

interface Goal {
  place: Place;
  frame: string;
}

export const goal: PanelKind = {
  name: "goal",
  title: "goal.title",
  supportedTypes: [],
  opens: (session) =>
    session.graph.value.actions.some(
      (name) => /\/(navigate_to_pose|move_base)$/.test(name) && session.may("goals", name),
    ),
  place: "controls",
  needsRobot: true,
  init: componentPanel(GoalPanel),
};

function GoalPanel({ context }: { context: PanelContext }) {
  const { navigation, visible, config } = context;
  const frames = useId();
  const problem = useSignal<Trouble | null>(null);
  // The goal begins where the robot is, until somebody moves it.
  const robot = useRobot(context, problem);
  const chosen = useSignal<Goal | null>(null);
  const { place, frame } = chosen.value ?? robot.value;
  const isVisible = visible.value;
  // Shown in the 3D view from the first change on, until it is sent or the panel is left.
  useEffect(() => {
    if (!isVisible) return undefined;
    navigation.draft.value = chosen.value;
    return () => {
      navigation.draft.value = null;
    };
  }, [navigation, isVisible, chosen.value]);
  if (!navigation.way) return <p class="faint">{t("goal.none")}</p>;
  const { x, y, yaw } = place;
  const step = Number(config.value.step ?? 0.5);
  const change = (part: Partial<Place>) => {
    chosen.value = { place: { ...place, ...part }, frame };
  };
  const shift = (along: number) => change({ x: x + along * Math.cos(yaw), y: y + along * Math.sin(yaw) });
  const set = (part: keyof Place, text: string) => {
    const value = Number(text);
    if (Number.isFinite(value)) change({ [part]: part === "yaw" ? (value * Math.PI) / 180 : value });
  };
  return (
    <form
      class="goal"
      onSubmit={(event) => {
        event.preventDefault();
        if (context.session.commands.block.peek()) return;
        navigation.send(place, frame);
        navigation.draft.value = null;
      }}
    >
      <div class="goal-numbers">
        <NumberInput label="x (m)" value={x} onChange={(text) => set("x", text)} />
        <NumberInput label="y (m)" value={y} onChange={(text) => set("y", text)} />
        <NumberInput
          label={t("goal.direction")}
          value={(yaw * 180) / Math.PI}
          onChange={(text) => set("yaw", text)}
        />
        <label>
          {t("goal.frame")}
          <input
            type="text"
            size={6}
            data-scan="next"
            list={frames}
            value={frame}
            onInput={(event) => {
              chosen.value = { place, frame: event.currentTarget.value };
            }}
          />
          <datalist id={frames}>
            {FRAMES.map((name) => (
              <option key={name} value={name} />
            ))}
          </datalist>
        </label>
        <Choice
          label={t("goal.step")}
          scan
          chosen={String(step)}
          options={STEPS.map((each) => [String(each), `${each} m`])}
          onChoose={(value) => {
            config.value = { ...config.value, step: Number(value) };
          }}
        />
      </div>
      <fieldset class="goal-buttons" data-scan-group aria-label={t("goal.move")}>
        <button type="button" data-scan="press" onClick={() => shift(step)}>
          {t("goal.ahead", { step })}
        </button>
        <button type="button" data-scan="press" onClick={() => shift(-step)}>
          {t("goal.behind", { step })}
        </button>
        <button type="button" data-scan="press" onClick={() => change({ yaw: yaw + TURN })}>
          {t("teleop.left")}
        </button>
        <button type="button" data-scan="press" onClick={() => change({ yaw: yaw - TURN })}>
          {t("teleop.right")}
        </button>
        <button
          type="button"
          data-scan="press"
          onClick={() => {
            chosen.value = null;
          }}
        >
          {t("goal.here")}
        </button>
      </fieldset>
      <div class="goal-buttons">
        <Commanding session={context.session}>
          <button type="submit" data-scan="press">
            {t("goal.go")}
          </button>
          {navigation.takesPose && (
            <button type="button" data-scan="press" onClick={() => navigation.setPose(place, frame)}>
              {t("goal.is")}
            </button>
          )}
        </Commanding>
      </div>
      <NavigationState navigation={navigation} />
      {problem.value && <Problem text={inWords(problem.value, t)} />}
      <p class="faint">{t("goal.by", { name: navigation.way.name })}</p>
    </form>
  );
}

/** Where the robot is by its odometry: in the map where tf tells how that lies there, else in odometry's own frame. */
function useRobot({ session, visible }: PanelContext, problem: Signal<Trouble | null>): Signal<Goal> {
  const robot = useSignal<Goal>({ place: { x: 0, y: 0, yaw: 0 }, frame: MAP });
  const odometry = session.topicsOf("nav_msgs/Odometry")[0] ?? "";
  const frames = useRef<Frames | null>(null);
  const take = (message: Message) => {
    const { position, orientation: q } = (message.pose as { pose: OdometryPose }).pose;
    const yaw = Math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z));
    const place = { x: position.x, y: position.y, yaw };
    const own = String((message.header as { frame_id?: unknown })?.frame_id || MAP);
    const inMap = frames.current?.pose(own);
    robot.value = inMap ? { place: placeFrom(inMap, place), frame: MAP } : { place, frame: own };
  };
  const isHeard = useMessages(session, odometry, take, { throttle: 500, isOn: visible.value });
  const tellsFrames = isHeard && session.graph.value.topics.has("/tf");
  useEffect(() => {
    if (!tellsFrames) return undefined;
    const begin = (module: typeof import("../../scene/frames")) => {
      frames.current = new module.Frames(session);
      frames.current.fix(MAP);
      return () => {
        frames.current?.dispose();
        frames.current = null;
      };
    };
    // With the library of the 3D view, which is loaded later than the page.
    return loadLater(
      () => import("../../scene/frames"),
      begin,
      (trouble) => (problem.value = trouble),
    );
  }, [session, tellsFrames, problem]);
  return robot;
}

/** A place of a frame that lies somewhere in another one, seen from that. */
function placeFrom(frame: Place, { x, y, yaw }: Place): Place {
  const [cos, sin] = [Math.cos(frame.yaw), Math.sin(frame.yaw)];
  return { x: frame.x + cos * x - sin * y, y: frame.y + sin * x + cos * y, yaw: frame.yaw + yaw };
}

interface OdometryPose {
  position: { x: number; y: number };
  orientation: { x: number; y: number; z: number; w: number };
}

function NumberInput(props: { label: string; value: number; onChange: (text: string) => void }) {
  return (
    <label>
      {props.label}
      <input
        type="number"
        step="any"
        value={Number(props.value.toFixed(3))}
        onChange={(event) => props.onChange(event.currentTarget.value)}
      />
    </label>
  );
}
