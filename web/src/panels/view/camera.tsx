/** A camera: the best stream that the robot has, with its age and rate, and stills of it. */

import { Circle, Download, Gauge, type IconNode, PictureInPicture2, Square } from "lucide";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { OldAge, useOldAge } from "../../elements/video/age";
import { IconButton } from "../../forms/icon";
import { Choice } from "../../forms/inputs";
import { Problem } from "../../forms/problem";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import {
  CAMERA_QUALITIES,
  CAMERA_TYPES,
  Camera,
  type CameraOptions,
  type CameraQuality,
  cameraTopics,
} from "../../robot/camera";
import { componentPanel, Needs, Refusal, saveAs, TopicChoice } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { fileName, Hud, useClip } from "./camera_parts";

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
  const quality =
    (Object.keys(CAMERA_QUALITIES) as CameraQuality[]).find((each) => each === config.value.quality) ??
    "auto";
  if (!topic) return <Needs kind={camera} />;
  if (!session.may("subscribe", topic)) return <Refusal context={context} act="subscribe" name={topic} />;
  return (
    <div class="camera">
      <div class="camera-bar">
        <TopicChoice context={context} topics={topics} chosen={topic} />
        <Choice
          label={t("camera.quality")}
          quiet
          chosen={quality}
          options={(Object.keys(CAMERA_QUALITIES) as CameraQuality[]).map((each) => [
            each,
            t(`scene.quality.${each}`),
          ])}
          onChoose={(chosen) => {
            config.value = { ...config.value, quality: chosen };
          }}
        />
      </div>
      {visible.value && session.connections.value > 0 && session.hasAsked && (
        <View key={`${topic} ${quality}`} context={context} topic={topic} options={{ quality }} />
      )}
    </div>
  );
}

/** Images of one camera. */
export function View(props: { context: PanelContext; topic: string; options?: CameraOptions }) {
  const { context, topic, options = {} } = props;
  const { config } = context;
  const canvas = useRef<HTMLCanvasElement>(null);
  const camera = useMemo(
    () =>
      new Camera(
        context.session,
        topic,
        (picture, width, height) => {
          const { current } = canvas;
          if (current) {
            if (current.width !== width) current.width = width;
            if (current.height !== height) current.height = height;
            current.getContext("2d")?.drawImage(picture, 0, 0);
          }
        },
        options,
      ),
    [context.session, topic, options.quality, options.messages],
  );
  useEffect(() => () => camera.dispose(), [camera]);
  const age = useOldAge(camera);
  const way = camera.way.value;
  const clip = useClip(canvas, topic);
  const hasHud = config.value.hud === true;
  const tool = (icon: IconNode, title: string, pressed: boolean | undefined, press: () => void) => (
    <IconButton of={icon} name={title} aria-pressed={pressed} onClick={press} />
  );
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
          <div class="camera-tools" role="toolbar" aria-label={t("camera.tools")}>
            {tool(
              Download,
              t("camera.still"),
              undefined,
              () => canvas.current && saveStill(canvas.current, topic),
            )}
            {tool(
              clip.isRecording ? Square : Circle,
              t(clip.isRecording ? "camera.clip.end" : "camera.clip"),
              clip.isRecording,
              clip.toggle,
            )}
            {tool(Gauge, t("camera.hud"), hasHud, () => {
              config.value = { ...config.value, hud: !hasHud };
            })}
            {document.pictureInPictureEnabled &&
              tool(PictureInPicture2, t("camera.pip"), undefined, () => {
                clip.float().catch((error: Error) => context.session.note("warning", error.message));
              })}
          </div>
        )}
        {hasHud && <Hud session={context.session} />}
        <p class="camera-state">
          {way ? (
            <>
              <span>
                {t(`camera.${way}`)} · {fixed(camera.rate.value, 1)} Hz
                {age.value === 0 && ` · ${fixed(camera.latency.value, 0)} ms`}
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
    if (blob) saveAs(blob, fileName(topic, "png"));
  }, "image/png");
}
