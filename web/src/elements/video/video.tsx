/** `<rwt-video>`: a camera, by the best way that the robot has. */

import { useEffect, useMemo, useRef } from "preact/hooks";
import { Problem } from "../../forms/problem";
import { useTexts } from "../../i18n/context";
import { CAMERA_TYPES, Camera, cameraTopics } from "../../robot/camera";
import { flag, text } from "../base/attributes";
import { COMMON, defineElement, RobotElement, type ViewProps } from "../base/element";
import { chooseTopic, NoTopic } from "../base/topic";
import { OldAge, useOldAge } from "./age";
import { style } from "./style";

export class VideoElement extends RobotElement {
  static override attributes = {
    ...COMMON,
    /** A topic of pictures; by default the first that there is. */
    topic: text(),
    /** Alternative text of the picture. */
    label: text(),
    /** True if the rate and transport of the pictures are shown below them. */
    details: flag(),
  };
  static override style = style;
  declare robot: string;
  declare topic: string;
  declare label: string;
  declare details: boolean;

  protected override readonly view = VideoView;

  /** The picture that is shown, as a PNG; null before the first. */
  still(): Promise<Blob | null> {
    const canvas = this.shadowRoot?.querySelector("canvas");
    return new Promise((resolve) => {
      if (canvas) canvas.toBlob(resolve, "image/png");
      else resolve(null);
    });
  }
}

function VideoView({ element, session }: ViewProps<VideoElement>) {
  const topic = chooseTopic(
    session,
    element.topic || cameraTopics(session)[0] || "",
    CAMERA_TYPES,
    useTexts(),
  );
  if ("problem" in topic) return <NoTopic problem={topic.problem} />;
  if (session.connections.value === 0) return null;
  return <Picture key={`${topic.name} ${topic.type}`} {...{ element, session }} topic={topic.name} />;
}

function Picture(props: Omit<ViewProps<VideoElement>, "stop"> & { topic: string }) {
  const { element, session, topic } = props;
  const t = useTexts();
  const canvas = useRef<HTMLCanvasElement>(null);
  const camera = useMemo(
    () =>
      new Camera(session, topic, (picture, width, height) => {
        const { current } = canvas;
        if (current) {
          // Setting them, even to what they are, makes a canvas empty.
          if (current.width !== width) current.width = width;
          if (current.height !== height) current.height = height;
          current.getContext("2d")?.drawImage(picture, 0, 0);
          element.tell("picture", { topic });
        }
      }),
    [element, session, topic],
  );
  useEffect(() => () => camera.dispose(), [camera]);
  const way = camera.way.value;
  const age = useOldAge(camera);
  return (
    <>
      {camera.problem.value && (
        <Problem text={t("widget.video.problem", { name: topic, reason: camera.problem.value })} />
      )}
      {way === null && !camera.problem.value && <p part="status">{t("panel.waiting", { name: topic })}</p>}
      <canvas
        part="picture"
        class={way === null ? "waiting" : age.value ? "shown old" : "shown"}
        ref={canvas}
        role="img"
        aria-label={element.label || t("camera.picture", { topic })}
      />
      <OldAge age={age} />
      {element.details && way && (
        <p part="details" class="faint">
          {t(`camera.${way}`)} · {camera.rate.value.toFixed(1)} Hz
        </p>
      )}
    </>
  );
}

defineElement("rwt-video", VideoElement);
