/** `<rwt-battery>`: how full the robot's battery is. */

import { useSignal } from "@preact/signals";
import { useTexts } from "../../i18n/context";
import { number, text } from "../base/attributes";
import { COMMON, defineElement, RobotElement, type ViewProps } from "../base/element";
import { type ChosenTopic, chooseTopic, NoTopic, useTopic } from "../base/topic";
import { style } from "./style";

const TYPES = ["sensor_msgs/BatteryState"];
/** `POWER_SUPPLY_STATUS_CHARGING` of sensor_msgs/BatteryState. */
const CHARGING = 1;

export class BatteryElement extends RobotElement {
  static override attributes = {
    ...COMMON,
    /** A topic of `sensor_msgs/BatteryState`; by default the first that there is. */
    topic: text(),
    /** Percent below which the battery counts as low. */
    low: number(20, 0, 100),
  };
  static override style = style;
  declare robot: string;
  declare topic: string;
  declare low: number;

  protected override readonly view = BatteryView;
}

function BatteryView({ element, session }: ViewProps<BatteryElement>) {
  const topic = chooseTopic(session, element.topic, TYPES, useTexts());
  if ("problem" in topic) return <NoTopic problem={topic.problem} />;
  return <Level key={topic.name} {...{ element, session, topic }} />;
}

function Level(props: Omit<ViewProps<BatteryElement>, "stop"> & { topic: ChosenTopic }) {
  const { element, session, topic } = props;
  const t = useTexts();
  const state = useSignal<{ percentage: number; charging: boolean } | null>(null);
  const wasLow = useSignal(false);
  useTopic(
    session,
    topic,
    ({ percentage, power_supply_status: status }) => {
      // The message counts from 0 to 1, and has NaN where it is not measured.
      const percent = typeof percentage === "number" ? percentage * 100 : Number.NaN;
      state.value = { percentage: percent, charging: status === CHARGING };
      const isLow = percent < element.low;
      if (isLow && !wasLow.value) element.tell("low", { percentage: percent });
      wasLow.value = isLow;
    },
    { throttle: 500 },
  );
  if (state.value === null) return <p part="status">{t("panel.waiting", { name: topic.name })}</p>;
  const { percentage, charging } = state.value;
  if (!Number.isFinite(percentage)) return <p part="status">{t("widget.battery.unknown")}</p>;
  const shown = Math.round(Math.min(Math.max(percentage, 0), 100));
  return (
    <span class="level">
      <meter
        part="meter"
        min={0}
        max={100}
        low={element.low}
        optimum={100}
        value={shown}
        aria-label={t("battery.title")}
      />
      <span part="value">
        {shown} %{charging && ` ${t("battery.charging")}`}
      </span>
    </span>
  );
}

defineElement("rwt-battery", BatteryElement);
