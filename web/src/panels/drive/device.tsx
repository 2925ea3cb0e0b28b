/** This device as a sensor of the robot: motion, position, battery, camera, microphone, joystick. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { SENSORS, type Sensor, startSensor } from "../../device/sensors";
import { blockText } from "../../forms/commanding";
import { Check } from "../../forms/inputs";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { componentPanel, Refusal } from "../component";
import type { PanelContext, PanelKind } from "../registry";

export const device: PanelKind = {
  name: "device",
  title: "device.title",
  supportedTypes: [],
  // It tells of the person who holds the device: it opens when that person wants it.
  opens: () => false,
  place: "controls",
  needsRobot: true,
  init: componentPanel(DevicePanel),
};

function DevicePanel({ context }: { context: PanelContext }) {
  const { config } = context;
  const namespace = String(config.value.namespace ?? "/device");
  return (
    <div class="device">
      <p class="faint">{t("device.hint")}</p>
      {!isSecureContext && <Problem text={t("device.insecure", { origin: location.origin })} />}
      <label class="choice">
        <span>{t("device.namespace")}</span>
        <input
          type="text"
          value={namespace}
          onChange={(event) => {
            const wanted = event.currentTarget.value;
            if (/^(\/[A-Za-z_]\w*)+$/.test(wanted)) config.value = { ...config.value, namespace: wanted };
          }}
        />
      </label>
      {SENSORS.map((sensor) => (
        <OneSensor
          key={`${namespace} ${sensor.name}`}
          context={context}
          sensor={sensor}
          namespace={namespace}
        />
      ))}
    </div>
  );
}

function OneSensor(props: { context: PanelContext; sensor: Sensor; namespace: string }) {
  const { context, sensor, namespace } = props;
  const { session } = context;
  const topic = `${namespace}/${sensor.topic}`;
  const on = useSignal(false);
  const count = useSignal(0);
  const problem = useSignal("");
  const control = useRef<AbortController | null>(null);
  useEffect(() => () => control.current?.abort(), []);
  const blocked = blockText(session, t);
  useEffect(() => {
    // A gamepad may drive the robot: after a stop or a lost connection it begins only when switched on again.
    if (!blocked || sensor.name !== "joystick") return;
    control.current?.abort();
    on.value = false;
  }, [blocked, sensor, on]);
  const topics = [topic, ...(sensor.description ? [`${namespace}/${sensor.description.topic}`] : [])];
  const closed = topics.find((each) => !session.may("publish", each));
  if (closed) return <Refusal context={context} act="publish" name={closed} />;
  const change = async (wanted: boolean) => {
    control.current?.abort();
    control.current = null;
    on.value = wanted;
    problem.value = "";
    if (!wanted) return;
    const current = new AbortController();
    control.current = current;
    const fail = (text: string) => {
      problem.value = text;
    };
    try {
      await startSensor(session, sensor, namespace, { message: () => count.value++, fail }, current.signal);
    } catch (error) {
      on.value = false;
      fail((error as Error).message);
    }
  };
  const available = isSecureContext && sensor.available();
  return (
    <div class="sensor">
      <Check
        name={sensor.name}
        checked={on.value}
        disabled={!available || (blocked !== "" && !on.value)}
        onChange={change}
      >
        {t(`device.${sensor.name}`)} <span class="faint">{topic}</span>
      </Check>
      {blocked && <span class="blocked">{blocked}</span>}
      {on.value && <span class="faint">{t("device.sent", { count: count.value })}</span>}
      {!available && isSecureContext && <span class="faint">{t("device.missing")}</span>}
      {problem.value && <Problem text={problem.value} />}
    </div>
  );
}
