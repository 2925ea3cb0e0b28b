/** `<rwt-topic>`: what a topic says last, or one value of it. */

import { useSignal } from "@preact/signals";
import { Problem } from "../../forms/problem";
import { useTexts } from "../../i18n/context";
import { valueAt } from "../../robot/fields";
import type { Message } from "../../robot/subscriptions";
import { number, text } from "../base/attributes";
import { COMMON, defineElement, RobotElement, type ViewProps } from "../base/element";
import { type ChosenTopic, chooseTopic, NoTopic, useTopic } from "../base/topic";
import { readable } from "./readable";
import { style } from "./style";

export class TopicElement extends RobotElement {
  static override attributes = {
    ...COMMON,
    /** The topic. */
    topic: text(),
    /** The path of the value to show, as `pose.pose.position.x`; by default the whole message. */
    field: text(),
    /** Digits after the point. */
    digits: number(3, 0, 15),
    /** Most messages a second. */
    rate: number(5, 0.1, 60),
  };
  static override style = style;
  declare robot: string;
  declare topic: string;
  declare field: string;
  declare digits: number;
  declare rate: number;

  protected override readonly view = TopicView;
}

function TopicView({ element, session }: ViewProps<TopicElement>) {
  const t = useTexts();
  if (!element.topic) return <Problem text={t("widget.topic.unnamed")} />;
  const topic = chooseTopic(session, element.topic, [], t);
  if ("problem" in topic) return <NoTopic problem={topic.problem} />;
  return <Value key={`${topic.name} ${topic.type}`} {...{ element, session, topic }} />;
}

function Value(props: Omit<ViewProps<TopicElement>, "stop"> & { topic: ChosenTopic }) {
  const { element, session, topic } = props;
  const t = useTexts();
  const last = useSignal<Message | null>(null);
  useTopic(
    session,
    topic,
    (message) => {
      last.value = message;
      element.tell("message", { topic: topic.name, message });
    },
    { throttle: 1000 / element.rate },
  );
  if (last.value === null) return <p part="status">{t("panel.waiting", { name: topic.name })}</p>;
  const value = valueAt(last.value, element.field);
  if (value === undefined) {
    return <Problem text={t("widget.field.none", { name: topic.name, field: element.field })} />;
  }
  const isWhole = value !== null && typeof value === "object";
  return isWhole ? (
    // biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls is scrolled by keys, too.
    <section part="value" class="message" tabIndex={0} aria-label={topic.name}>
      {readable(value, element.digits)}
    </section>
  ) : (
    <output part="value">{readable(value, element.digits)}</output>
  );
}

defineElement("rwt-topic", TopicElement);
