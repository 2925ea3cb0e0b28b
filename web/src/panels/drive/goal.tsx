/** Sending the robot somewhere by numbers and buttons: what the scene does with the mouse, for everybody. */

import { useSignal } from "@preact/signals";
import { useEffect, useId } from "preact/hooks";
import { Choice } from "../../forms/inputs";
import { t } from "../../i18n/text";
import type { Place } from "../../robot/navigation";
import { componentPanel } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { NavigationState } from "./navigation_state";

/** How far one press moves the goal, in metres, and how much it turns it, in radians. */
const STEPS = [0.1, 0.5, 2];
const TURN = Math.PI / 8;
/** Frames that a goal is usually said in. */
const FRAMES = ["map", "odom", "base_link"];

export const goal: PanelKind = {
  name: "goal",
  title: "goal.title",
  supportedTypes: [],
  opens: (session) =>
    session.graph.value.actions.some(
      (name) => /\/(navigate_to_pose|move_base)$/.test(name) && session.may("goals", name),
    ),
  place: "controls",
  init: componentPanel(GoalPanel),
};

function GoalPanel({ context }: { context: PanelContext }) {
  const { session, navigation, stop, visible, config } = context;
  const frames = useId();
  const place = useSignal<Place>({ x: 0, y: 0, yaw: 0 });
  const frame = useSignal("map");
  const touched = useSignal(false);
  const odometry = session.topicsOf("nav_msgs/Odometry")[0] ?? "";
  const isVisible = visible.value;
  useEffect(() => {
    if (!odometry || !isVisible) return undefined;
    return session.subscribe(
      odometry,
      session.graph.peek().topics.get(odometry) ?? "",
      (message) => {
        // The goal begins where the robot is, until somebody moves it.
        if (touched.value) return;
        const { position, orientation: q } = (message.pose as { pose: OdometryPose }).pose;
        // Where the robot is, it says in a frame of its own.
        frame.value = String((message.header as { frame_id?: unknown })?.frame_id || "map");
        const yaw = Math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z));
        place.value = { x: position.x, y: position.y, yaw };
      },
      { throttle: 500 },
    );
  }, [session, odometry, isVisible, touched, place, frame]);
  // Shown in the 3D view from the first change on, until it is sent or the panel is left.
  useEffect(() => {
    if (!touched.value || !isVisible) return undefined;
    navigation.draft.value = { place: place.value, frame: frame.value };
    return () => {
      navigation.draft.value = null;
    };
  }, [navigation, touched.value, isVisible, place.value, frame.value]);
  if (!navigation.way) return <p class="faint">{t("goal.none")}</p>;
  const { x, y, yaw } = place.value;
  const step = Number(config.value.step ?? 0.5);
  const shift = (along: number, turn: number) => {
    touched.value = true;
    place.value = {
      x: x + along * Math.cos(yaw),
      y: y + along * Math.sin(yaw),
      yaw: yaw + turn,
    };
  };
  const set = (part: keyof Place, text: string) => {
    const value = Number(text);
    if (!Number.isFinite(value)) return;
    touched.value = true;
    place.value = { ...place.value, [part]: part === "yaw" ? (value * Math.PI) / 180 : value };
  };
  return (
    <form
      class="goal"
      onSubmit={(event) => {
        event.preventDefault();
        if (stop.stopped.value) return;
        navigation.send(place.value, frame.value);
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
            value={frame.value}
            onInput={(event) => {
              touched.value = true;
              frame.value = event.currentTarget.value;
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
        <button type="button" data-scan="press" onClick={() => shift(step, 0)}>
          {t("goal.ahead", { step })}
        </button>
        <button type="button" data-scan="press" onClick={() => shift(-step, 0)}>
          {t("goal.behind", { step })}
        </button>
        <button type="button" data-scan="press" onClick={() => shift(0, TURN)}>
          {t("goal.left")}
        </button>
        <button type="button" data-scan="press" onClick={() => shift(0, -TURN)}>
          {t("goal.right")}
        </button>
        <button
          type="button"
          data-scan="press"
          onClick={() => {
            touched.value = false;
          }}
        >
          {t("goal.here")}
        </button>
      </fieldset>
      <div class="goal-buttons">
        <button type="submit" data-scan="press" disabled={stop.stopped.value}>
          {t("goal.go")}
        </button>
        {navigation.takesPose && (
          <button
            type="button"
            data-scan="press"
            onClick={() => navigation.setPose(place.value, frame.value)}
          >
            {t("goal.is")}
          </button>
        )}
      </div>
      <NavigationState navigation={navigation} />
      <p class="faint">{t("goal.by", { name: navigation.way.name })}</p>
    </form>
  );
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
