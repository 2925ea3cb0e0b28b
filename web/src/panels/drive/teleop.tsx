/** Teleoperation: hold to run, by stick, buttons, keyboard or gamepad. */

import { useSignal } from "@preact/signals";
import { SlidersHorizontal } from "lucide";
import { useEffect, useLayoutEffect, useMemo, useRef } from "preact/hooks";
import { followKeys, HoldButtons, releaseWithPage, Stick } from "../../elements/teleop/controls";
import { followGamepad, wishOfGamepad } from "../../elements/teleop/gamepad";
import { blockText } from "../../forms/commanding";
import { Clamped, Driver } from "../../forms/gate";
import { Icon } from "../../forms/icon";
import { Check, Slider } from "../../forms/inputs";
import { useNarrow } from "../../forms/narrow";
import { Problem } from "../../forms/problem";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { cameraTopics } from "../../robot/camera";
import { Drive, driveTopics } from "../../robot/drive";
import { componentPanel, Needs, now, Refusal, TopicChoice } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { View } from "../view/camera";

/** The least limit that can be set, and by how much a button changes one, in m/s and rad/s. */
const LEAST_LIMIT = 0.05;
const LIMIT_STEP = 0.1;
const TYPES = ["geometry_msgs/Twist", "geometry_msgs/TwistStamped"];

export const teleop: PanelKind = {
  name: "teleop",
  title: "teleop.title",
  supportedTypes: TYPES,
  opens: (session) => driveTopics(session).some((topic) => session.may("publish", topic)),
  place: "controls",
  needsRobot: true,
  init: componentPanel(TeleopPanel),
};

function TeleopPanel({ context }: { context: PanelContext }) {
  const { session, config } = context;
  const topics = driveTopics(session);
  const topic = String(config.value.topic ?? topics[0] ?? "");
  const camera = cameraTopics(session)[0];
  const narrow = useNarrow();
  if (!topic) return <Needs kind={teleop} />;
  // Where there is room for one panel, the camera is behind the controls.
  const feed = narrow && context.visible.value && session.hasAsked ? camera : undefined;
  return (
    <div class={feed ? "teleop over-camera" : "teleop"}>
      {feed && (
        <div class="camera">
          <View key={feed} context={context} topic={feed} />
        </div>
      )}
      {topics.length > 1 && <TopicChoice context={context} topics={topics} scan chosen={topic} />}
      {session.may("publish", topic) ? (
        <Controls key={topic} context={context} topic={topic} isPhone={feed !== undefined} />
      ) : (
        <Refusal context={context} act="publish" name={topic} />
      )}
    </div>
  );
}

function Controls(props: { context: PanelContext; topic: string; isPhone: boolean }) {
  const { context, topic, isPhone } = props;
  const limitsShown = useSignal(false);
  const { session, stop, config, visible } = context;
  const type = session.graph.peek().topics.get(topic) ?? "geometry_msgs/Twist";
  const drive = useMemo(() => new Drive(session, topic, type), [session, topic, type]);
  const limits = {
    linear: Number(config.value.linear ?? 0.4),
    angular: Number(config.value.angular ?? 0.8),
  };
  drive.limits = limits;
  const pad = useRef<HTMLFieldSetElement>(null);
  // Before the page is drawn, since what is seen to be there may be pressed.
  useLayoutEffect(() => {
    const endPage = releaseWithPage(drive, () => stop.gate.giveBack(topic));
    const endGamepad = followGamepad(wishOfGamepad, {
      isHeld: () => drive.holds("gamepad"),
      hold: (wish) => drive.hold("gamepad", wish),
      release: () => drive.release("gamepad"),
    });
    const endAwake = keepAwake(drive);
    return () => {
      endPage();
      endAwake();
      endGamepad();
      drive.dispose();
    };
  }, [drive, stop, topic]);
  useLayoutEffect(() => {
    if (!visible.value) drive.releaseAll();
  }, [drive, visible.value]);
  useLayoutEffect(() => {
    const here = pad.current as HTMLElement;
    return followKeys(document, drive, (event) => {
      if (here.contains(event.target as Node)) return true;
      // Of several Drive panels one drives. Arrow keys belong to what has the focus.
      const isFirst = document.querySelector(".panel .drive") === here;
      const isFree = event.target === document.body || (event.target as HTMLElement).id === "panels";
      return isFirst && context.visible.peek() && (isFree || event.key.length === 1);
    });
  }, [drive, context]);
  const sounds = config.value.sound === true;
  const isStalled = drive.stalled.value;
  useEffect(() => {
    if (isStalled && sounds) beep();
  }, [isStalled, sounds]);
  const { linear, lateral, angular } = drive.sent.value;
  // Before the robot has said of which type the topic is, a grip would be lost when it does.
  const why = blockText(session, t);
  const idle = why !== "" || !session.hasAsked;
  return (
    <fieldset class="drive" ref={pad} aria-describedby="teleop-hint">
      <legend class="hidden">{topic}</legend>
      <div class="drive-controls">
        <Stick drive={drive} disabled={idle} />
        <HoldButtons drive={drive} disabled={idle} sideways={config.value.sideways === true} />
      </div>
      <output class="drive-sent">
        <Meter value={linear} most={limits.linear} unit="m/s" /> ·{" "}
        {lateral ? (
          <>
            <Meter value={lateral} most={limits.linear} unit={`m/s ${t("teleop.sideways")}`} /> ·{" "}
          </>
        ) : null}
        <Meter value={angular} most={limits.angular} unit="rad/s" />
      </output>
      <Driver gate={stop.gate} topic={topic} session={session} />
      <Clamped session={session} topic={topic} now={now.value} />
      {isPhone && (
        <button
          type="button"
          class="show-limits"
          data-scan="press"
          aria-expanded={limitsShown.value}
          onClick={() => {
            limitsShown.value = !limitsShown.value;
          }}
        >
          <Icon of={SlidersHorizontal} /> {t("teleop.limits")}
        </button>
      )}
      <fieldset
        class="limits"
        hidden={isPhone && !limitsShown.value}
        data-scan-group
        aria-label={t("teleop.limits")}
      >
        <Limit context={context} name="linear" value={limits.linear} most={2} unit="m/s" />
        <Limit context={context} name="angular" value={limits.angular} most={3} unit="rad/s" />
        <Check
          scan
          checked={config.value.sideways === true}
          onChange={(sideways) => {
            config.value = { ...config.value, sideways };
          }}
        >
          {t("teleop.sideways.buttons")}
        </Check>
        <Check
          scan
          checked={sounds}
          onChange={(sound) => {
            config.value = { ...config.value, sound };
          }}
        >
          {t("teleop.sound")}
        </Check>
      </fieldset>
      {drive.stalled.value && !why && <Problem text={t("teleop.stalled")} />}
      {session.silence.value > 0 && <Problem text={t("teleop.silent")} />}
      {why && session.silence.value === 0 && <p class="blocked">{why}</p>}
      <p class="faint" id="teleop-hint">
        {t("teleop.hint", { topic })}
      </p>
    </fieldset>
  );
}

/** A speed that is commanded, and a bar from the middle for its share of the limit. */
function Meter({ value, most, unit }: { value: number; most: number; unit: string }) {
  const bar = useRef<HTMLSpanElement>(null);
  const share = Math.max(-1, Math.min(1, value / most)) * 50;
  useLayoutEffect(() => {
    bar.current?.style.setProperty("left", `${Math.min(50, 50 + share)}%`);
    bar.current?.style.setProperty("width", `${Math.abs(share)}%`);
  }, [share]);
  return (
    <span class="meter">
      <b>{fixed(value, 2)}</b> {unit}
      <span class="meter-bar" aria-hidden="true">
        <span ref={bar} />
      </span>
    </span>
  );
}

function Limit(props: {
  context: PanelContext;
  name: "linear" | "angular";
  value: number;
  most: number;
  unit: string;
}) {
  const { context, name, value, most, unit } = props;
  return (
    <Slider
      label={t(`teleop.${name}`)}
      value={value}
      least={LEAST_LIMIT}
      most={most}
      step={0.05}
      by={LIMIT_STEP}
      shown={`${fixed(value, 2)} ${unit}`}
      onChange={(wanted) => {
        const limit = Math.min(Math.max(Math.round(wanted * 100) / 100, LEAST_LIMIT), most);
        context.config.value = { ...context.config.value, [name]: limit };
      }}
    />
  );
}

/** Hertz and seconds of the sound that tells that driving has ended. */
const TONE = 660;
const TONE_S = 0.25;

function beep(): void {
  const audio = new AudioContext();
  const tone = audio.createOscillator();
  tone.frequency.value = TONE;
  tone.connect(audio.destination);
  tone.onended = () => void audio.close();
  tone.start();
  tone.stop(audio.currentTime + TONE_S);
}

/** Milliseconds for which a phone vibrates when a control is taken. */
const VIBRATION = 15;

/** Keep the screen on while the robot is driven, and let it be felt that a control is taken. */
function keepAwake(drive: Drive): () => void {
  let lock: Promise<WakeLockSentinel | null> | null = null;
  const end = drive.moving.subscribe((moving) => {
    if (moving) {
      navigator.vibrate?.(VIBRATION);
      // Refused without power, or while the page is hidden: then the screen goes as usual.
      lock ??= navigator.wakeLock?.request("screen").catch(() => null) ?? null;
    } else {
      void lock?.then((held) => held?.release());
      lock = null;
    }
  });
  return () => {
    end();
    void lock?.then((held) => held?.release());
  };
}
