/** `<rwt-teleop>`: a stick, buttons and keys that drive the robot while they are held. */

import { useLayoutEffect, useMemo, useRef } from "preact/hooks";
import { Driver, stopText } from "../../forms/gate";
import { Problem } from "../../forms/problem";
import { useTexts } from "../../i18n/context";
import { Drive, driveTopics } from "../../robot/drive";
import { choice, number, text } from "../base/attributes";
import { COMMON, defineElement, RobotElement, type ViewProps } from "../base/element";
import { followKeys, HoldButtons, releaseWithPage, Stick } from "./controls";
import { style } from "./style";

export class TeleopElement extends RobotElement {
  static override attributes = {
    ...COMMON,
    /** Where velocities go; by default the likeliest topic that the robot has. */
    topic: text(),
    /** Metres per second at full deflection. */
    maxLinear: number(0.5, 0, 20),
    /** Radians per second at full deflection. */
    maxAngular: number(1, 0, 20),
    /** When keys drive: while the focus is in the element, from anywhere in the page, or never. */
    keys: choice("focus", "page", "off"),
    /** Shown controls. */
    controls: choice("all", "stick", "buttons"),
  };
  static override style = style;
  declare robot: string;
  declare topic: string;
  declare maxLinear: number;
  declare maxAngular: number;
  declare keys: "focus" | "page" | "off";
  declare controls: "all" | "stick" | "buttons";

  protected override readonly view = TeleopView;
}

function TeleopView({ element, session, stop }: ViewProps<TeleopElement>) {
  const t = useTexts();
  const topic = element.topic || driveTopics(session)[0] || "";
  if (!topic) {
    if (session.state.value !== "open" || session.graph.value.topics.size === 0) return null;
    return <Problem text={t("widget.teleop.nothing")} />;
  }
  if (!session.may("publish", topic)) {
    const { role } = session.permissions.value;
    return <Problem text={t("role.refused", { role, act: t("act.publish"), name: topic })} />;
  }
  const type = session.graph.value.topics.get(topic) ?? "geometry_msgs/Twist";
  return <Controls key={`${topic} ${type}`} {...{ element, session, stop, topic, type }} />;
}

function Controls(props: ViewProps<TeleopElement> & { topic: string; type: string }) {
  const { element, session, stop, topic, type } = props;
  const t = useTexts();
  const drive = useMemo(() => new Drive(session, topic, type), [session, topic, type]);
  drive.limits = { linear: element.maxLinear, angular: element.maxAngular };
  const pad = useRef<HTMLFieldSetElement>(null);
  // Before the page is drawn, since what is seen to be there may be pressed.
  useLayoutEffect(() => {
    const endPage = releaseWithPage(drive, () => stop.gate.giveBack(topic));
    const endTelling = tellOf(element, drive, topic);
    return () => {
      endPage();
      drive.dispose();
      endTelling();
    };
  }, [drive, element, topic, stop]);
  const { keys, controls } = element;
  useLayoutEffect(() => {
    if (keys === "off" || !pad.current) return undefined;
    return followKeys(keys === "page" ? document : pad.current, drive);
  }, [drive, keys]);
  const { linear, lateral, angular } = drive.sent.value;
  // A server that does not say beforehand what is allowed says it when a velocity comes.
  const refusal = session.notices.value.findLast(({ level, about }) => level === "error" && about === topic);
  const stopped = stop.stopped.value;
  // Before the robot has said of which type the topic is, a grip would be lost when it does.
  const idle = session.commands.block.value !== null || !session.hasAsked;
  // Without a button in it, the keyboard needs a place to be.
  const place = controls === "stick" && keys === "focus" ? { tabIndex: 0 } : {};
  return (
    <fieldset part="controls" class="drive" ref={pad} {...place}>
      <legend class="hidden">{t("widget.teleop.legend", { topic })}</legend>
      {controls !== "buttons" && <Stick drive={drive} disabled={idle} />}
      {controls !== "stick" && <HoldButtons drive={drive} disabled={idle} />}
      <output part="status" class="speeds">
        {linear.toFixed(2)} m/s{lateral !== 0 && ` · ${lateral.toFixed(2)} m/s ${t("teleop.sideways")}`} ·{" "}
        {angular.toFixed(2)} rad/s
      </output>
      <Driver gate={stop.gate} topic={topic} session={session} />
      {refusal && <Problem text={refusal.text} />}
      {drive.stalled.value && !idle && <Problem text={t("teleop.stalled")} />}
      {session.silence.value > 0 && <Problem text={t("teleop.silent")} />}
      {stopped && <Problem text={stopText(stop, t)} />}
    </fieldset>
  );
}

/** Tell the page when a control is taken and let go, and what is sent meanwhile. */
function tellOf(element: TeleopElement, drive: Drive, topic: string): () => void {
  let moved = false;
  const endMoving = drive.moving.subscribe((moving) => {
    if (moving !== moved) element.tell(moving ? "hold" : "release", { topic });
    moved = moving;
  });
  let first = true;
  const endSent = drive.sent.subscribe((sent) => {
    if (!first) element.tell("drive", { topic, ...sent });
    first = false;
  });
  return () => {
    endMoving();
    endSent();
  };
}

defineElement("rwt-teleop", TeleopElement);
