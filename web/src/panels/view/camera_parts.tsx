/** Parts of a camera's view: speed and heading over the image, clips, and a window of its own. */

import { useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import type { RobotSession } from "../../robot/session";
import type { Message } from "../../robot/subscriptions";
import { saveAs, useMessages } from "../component";

/** Images a second of a clip, and the milliseconds after which it ends by itself: it is kept in memory. */
const CLIP_RATE = 15;
const LONGEST_CLIP = 5 * 60_000;

/** Name of a file of a topic, made now. */
export function fileName(topic: string, extension: string): string {
  const name = topic.replace(/\W+/g, "_").replace(/^_/, "");
  return `${name}-${new Date().toISOString()}.${extension}`;
}

/** Record what a canvas shows, and show it in a window above all others. */
export function useClip(canvas: RefObject<HTMLCanvasElement | null>, topic: string) {
  const recording = useSignal(false);
  const recorder = useRef<MediaRecorder | null>(null);
  useEffect(() => () => recorder.current?.stop(), []);
  const toggle = () => {
    if (recorder.current) {
      recorder.current.stop();
      return;
    }
    const stream = canvas.current?.captureStream(CLIP_RATE);
    if (!stream) return;
    const made = new MediaRecorder(stream);
    const parts: Blob[] = [];
    const timer = setTimeout(() => made.stop(), LONGEST_CLIP);
    made.ondataavailable = ({ data }) => parts.push(data);
    made.onstop = () => {
      clearTimeout(timer);
      for (const track of stream.getTracks()) track.stop();
      recorder.current = null;
      recording.value = false;
      const extension = made.mimeType.includes("mp4") ? "mp4" : "webm";
      saveAs(new Blob(parts, { type: made.mimeType }), fileName(topic, extension));
    };
    made.start();
    recorder.current = made;
    recording.value = true;
  };
  const float = async () => {
    const stream = canvas.current?.captureStream();
    if (!stream) return;
    const video = document.createElement("video");
    video.muted = true;
    video.srcObject = stream;
    video.addEventListener("leavepictureinpicture", () => {
      for (const track of stream.getTracks()) track.stop();
    });
    await video.play();
    await video.requestPictureInPicture();
  };
  return { isRecording: recording.value, toggle, float };
}

/** Speed and heading by the odometry, over the image. */
export function Hud({ session }: { session: RobotSession }) {
  const motion = useSignal<{ speed: number; turn: number; heading: number } | null>(null);
  const topic = session.topicsOf("nav_msgs/Odometry")[0] ?? "";
  const take = (message: Message) => {
    const { pose, twist } = message as unknown as Odometry;
    const { x, y, z, w } = pose.pose.orientation;
    const yaw = Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
    const { linear, angular } = twist.twist;
    motion.value = { speed: linear.x, turn: angular.z, heading: (yaw * 180) / Math.PI };
  };
  useMessages(session, topic, take, { throttle: 100 });
  if (!motion.value) return null;
  const { speed, turn, heading } = motion.value;
  const signed = (value: number) => fixed(value, 2);
  return (
    <p class="camera-hud">
      <span>
        <b>{signed(speed)}</b> m/s
      </span>
      <span>
        <b>{signed(turn)}</b> rad/s
      </span>
      <span>
        <svg viewBox="-10 -10 20 20" width="18" height="18" aria-hidden="true">
          <path d="M0-8 5 7 0 4-5 7Z" transform={`rotate(${-heading})`} />
        </svg>
        <span class="hidden">{t("camera.heading")}</span> <b>{fixed(heading, 0)}°</b>
      </span>
    </p>
  );
}

interface Odometry {
  pose: { pose: { orientation: { x: number; y: number; z: number; w: number } } };
  twist: { twist: { linear: { x: number }; angular: { z: number } } };
}
