/** Moving an arm: a slider for each joint. */

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useMemo } from "preact/hooks";
import { releaseWithPage } from "../../elements/teleop/controls";
import { followGamepad, pushOfGamepad } from "../../elements/teleop/gamepad";
import { blockText } from "../../forms/commanding";
import { Clamped, Driver } from "../../forms/gate";
import { Choice, Slider } from "../../forms/inputs";
import { Problem } from "../../forms/problem";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { hearDescription } from "../../robot/description";
import { driveTopics } from "../../robot/drive";
import { Jog, type Joint, jointsOf, TRAJECTORY, trajectoryTopics, undescribed } from "../../robot/jog";
import type { Message } from "../../robot/subscriptions";
import { componentPanel, Needs, now, Refusal, TopicChoice, useMessages } from "../component";
import { logLevel } from "../health/log";
import type { PanelContext, PanelKind } from "../registry";

const STATES = "/joint_states";
/** Milliseconds between two joint states. */
const THROTTLE = 100;
/** Shares of the maximum speed; controllers that check speeds need some reserve. */
const SHARES = ["0.1", "0.25", "0.5"];
/** Radians or metres by which a button moves a joint. */
const STEP = { turning: 0.05, linear: 0.01 };
/** Place of warnings among the levels of the log. */
const WARNING = 2;

export const joints: PanelKind = {
  name: "joints",
  title: "joints.title",
  supportedTypes: [TRAJECTORY],
  // A mobile robot with an arm is driven first: there, people open it.
  opens: (session) =>
    driveTopics(session).length === 0 &&
    trajectoryTopics(session).some((topic) => session.may("publish", topic)),
  place: "controls",
  needsRobot: true,
  init: componentPanel(JointsPanel),
};

function JointsPanel({ context }: { context: PanelContext }) {
  const { session, config } = context;
  const topics = trajectoryTopics(session);
  const topic = String(config.value.topic ?? topics[0] ?? "");
  const measured = useStates(context);
  const known = useJoints(context, topic, measured);
  if (!topic) return <Needs kind={joints} />;
  return (
    <div class="joints">
      {topics.length > 1 && <TopicChoice context={context} topics={topics} scan chosen={topic} />}
      {!session.may("publish", topic) ? (
        <Refusal context={context} act="publish" name={topic} />
      ) : known.length ? (
        <Controls
          key={`${topic} ${known.map(({ name }) => name).join(" ")}`}
          context={context}
          topic={topic}
          known={known}
          measured={measured}
        />
      ) : (
        <p class="faint">{t("joints.waiting", { topic: STATES })}</p>
      )}
    </div>
  );
}

type Positions = ReadonlyMap<string, number>;

function Controls(props: {
  context: PanelContext;
  topic: string;
  known: readonly Joint[];
  measured: Signal<Positions>;
}) {
  const { context, topic, known, measured } = props;
  const { session, stop, config, visible } = context;
  const jog = useMemo(() => new Jog(session, topic, known), [session, topic, known]);
  jog.share = Number(config.value.share ?? SHARES[1]);
  jog.measure(measured.value);
  const rejection = useRejection(context, topic);
  useLayoutEffect(() => {
    const endPage = releaseWithPage(jog, () => stop.gate.giveBack(topic));
    return () => {
      endPage();
      jog.dispose();
    };
  }, [jog, stop, topic]);
  useLayoutEffect(() => {
    if (!visible.value) {
      jog.releaseAll();
      return undefined;
    }
    const names = known.map(({ name }) => name);
    return followGamepad((pad) => pushOfGamepad(pad, names), {
      isHeld: () => jog.isPushed,
      hold: (shares) => jog.push(shares),
      release: () => jog.release(),
    });
  }, [jog, known, visible.value]);
  const why = blockText(session, t);
  return (
    <>
      <fieldset class="jog" disabled={why !== ""} title={why} data-scan-group>
        <legend class="hidden">{topic}</legend>
        {known.map(({ name, lower, upper, isLinear }) => {
          const here = measured.value.get(name);
          const shown = here === undefined ? "" : isLinear ? `${fixed(here, 3)} m` : degrees(here);
          return (
            <Slider
              key={name}
              label={name}
              value={jog.wanted.value.get(name) ?? here ?? lower}
              least={lower}
              most={upper}
              step={isLinear ? 0.001 : 0.01}
              by={isLinear ? STEP.linear : STEP.turning}
              shown={shown}
              onChange={(position) => {
                rejection.value = "";
                jog.move(name, position);
              }}
            />
          );
        })}
      </fieldset>
      <div class="row">
        <button type="button" data-scan="press" onClick={() => jog.hold()}>
          {t("joints.hold")}
        </button>
        <Choice
          label={t("player.rate")}
          scan
          chosen={String(jog.share)}
          options={SHARES.map((share) => [share, `${Number(share) * 100} %`])}
          onChoose={(share) => {
            config.value = { ...config.value, share: Number(share) };
          }}
        />
      </div>
      <Driver gate={stop.gate} topic={topic} session={session} />
      <Clamped session={session} topic={topic} now={now.value} />
      {rejection.value && <Problem text={rejection.value} />}
      {why && <p class="blocked">{why}</p>}
      <p class="faint">{t("joints.hint", { topic })}</p>
    </>
  );
}

function degrees(radians: number): string {
  return `${fixed((radians * 180) / Math.PI, 1)}°`;
}

function namesOf(value: unknown): string[] {
  return Array.isArray(value) ? value.map(String) : [];
}

/** Positions of all joints of the robot, while the panel is seen. */
function useStates({ session, visible }: PanelContext): Signal<Positions> {
  const measured = useSignal<Positions>(new Map());
  const take = ({ name, position }: Message) => {
    const pairs = new Map(measured.peek());
    const positions = (position ?? []) as ArrayLike<number>;
    for (const [at, joint] of namesOf(name).entries()) {
      const value = positions[at];
      if (typeof value === "number" && Number.isFinite(value)) pairs.set(joint, value);
    }
    measured.value = pairs;
  };
  useMessages(session, STATES, take, { throttle: THROTTLE, isOn: visible.value });
  return measured;
}

/**
 * The joints that a topic's trajectories need: those that its controller names (ROS's joint_trajectory_controller does),
 * else those of the robot's description, else all.
 */
function useJoints({ session }: PanelContext, topic: string, measured: Signal<Positions>): readonly Joint[] {
  const described = useSignal<readonly Joint[]>([]);
  const controlled = useSignal<readonly string[]>([]);
  useEffect(
    () =>
      hearDescription(session, (urdf) => {
        described.value = jointsOf(urdf);
      }),
    [session, described],
  );
  const controller = topic.replace(/[^/]*$/, "controller_state");
  const type = session.graph.value.topics.get(controller) ?? "";
  const isHeard = type !== "" && session.may("subscribe", controller);
  useEffect(() => {
    controlled.value = [];
    if (!isHeard) return undefined;
    const end = session.subscribe(controller, type, ({ joint_names }) => {
      controlled.value = namesOf(joint_names);
      queueMicrotask(() => end());
    });
    return end;
  }, [session, controller, type, isHeard, controlled]);
  const names = JSON.stringify([...measured.value.keys()].sort());
  const [all, wanted] = [described.value, controlled.value];
  return useMemo(() => {
    const there = JSON.parse(names) as string[];
    const limited = all.filter(({ name }) => there.includes(name));
    const usual = limited.length ? limited : undescribed(there);
    if (!wanted.length) return usual;
    // In the controller's order.
    return wanted.flatMap((name) => usual.find((each) => each.name === name) ?? undescribed([name]));
  }, [all, wanted, names]);
}

/** The last warning of the robot's log about a topic: controllers reject trajectories in no other way. */
function useRejection({ session, visible }: PanelContext, topic: string): Signal<string> {
  const rejection = useSignal("");
  const take = ({ level, msg }: Message) => {
    if (logLevel(Number(level)) >= WARNING && String(msg).includes(topic)) rejection.value = String(msg);
  };
  useMessages(session, "/rosout", take, { isOn: visible.value });
  return rejection;
}
