/** A camera: the best stream that the robot has, with its age and rate, and stills of it. */

import { Download } from "lucide";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { OldAge, useOldAge } from "../../elements/video/age";
import { Icon } from "../../forms/icon";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { CAMERA_TYPES, Camera, cameraTopics } from "../../robot/camera";
import { componentPanel, Refusal, saveAs, TopicChoice } from "../component";
import type { PanelContext, PanelKind } from "../registry";

export const camera: PanelKind = {
  name: "camera",
  title: "camera.title",
  supportedTypes: CAMERA_TYPES,
  opens: (session) => cameraTopics(session).length > 0,
  place: "right",
  init: componentPanel(CameraPanel),
};

function CameraPanel({ context }: { context: PanelContext }) {
  const { session, config, visible } = context;
  const topics = cameraTopics(session);
  const topic = String(config.value.topic ?? topics[0] ?? "");
  if (!topic) return <p class="faint">{t("panel.nothing")}</p>;
  if (!session.may("subscribe", topic)) return <Refusal context={context} act="subscribe" name={topic} />;
  return (
    <div class="camera">
      <TopicChoice
        label={t("panel.topic")}
        topics={topics}
        chosen={topic}
        onChoose={(chosen) => {
          config.value = { ...config.value, topic: chosen };
        }}
      />
      {visible.value && session.connections.value > 0 && session.hasAsked && (
        <View key={topic} context={context} topic={topic} />
      )}
    </div>
  );
}

/** Images of one camera. */
export function View({ context, topic }: { context: PanelContext; topic: string }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const camera = useMemo(
    () =>
      new Camera(context.session, topic, (picture, width, height) => {
        const { current } = canvas;
        if (current) {
          if (current.width !== width) current.width = width;
          if (current.height !== height) current.height = height;
          current.getContext("2d")?.drawImage(picture, 0, 0);
        }
      }),
    [context.session, topic],
  );
  useEffect(() => () => camera.dispose(), [camera]);
  const age = useOldAge(camera);
  const way = camera.way.value;
  return (
    <>
      <div class="camera-view">
        <canvas
          class={age.value ? "old" : ""}
          ref={canvas}
          width={4}
          height={3}
          role="img"
          aria-label={t("camera.picture", { topic })}
        />
        {way && (
          <button
            type="button"
            class="camera-still"
            onClick={() => canvas.current && saveStill(canvas.current, topic)}
          >
            <Icon of={Download} />
            <span class="words">{t("camera.still")}</span>
          </button>
        )}
        <p class="camera-state">
          {way ? (
            <>
              <span>
                {t(`camera.${way}`)} · {camera.rate.value.toFixed(1)} Hz
              </span>
              <OldAge age={age} />
            </>
          ) : (
            <span>{t("panel.waiting", { name: topic })}</span>
          )}
        </p>
      </div>
      {camera.problem.value && <Problem text={camera.problem.value} />}
    </>
  );
}

function saveStill(canvas: HTMLCanvasElement, topic: string): void {
  canvas.toBlob((blob) => {
    const name = topic.replace(/\W+/g, "_").replace(/^_/, "");
    if (blob) saveAs(blob, `${name}-${new Date().toISOString()}.png`);
  }, "image/png");
}
