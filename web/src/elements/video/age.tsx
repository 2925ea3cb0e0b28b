/** The age of a camera's image, as the Camera panel and `<rwt-video>` show it. */

import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { useTexts } from "../../i18n/context";
import type { Camera } from "../../robot/camera";

/** Seconds after which an image is shown as old. */
const OLD = 0.5;
/** Milliseconds between two looks. */
const LOOK = 100;

/** The age of the image in seconds once it is old; 0 before, and without an image. */
export function useOldAge(camera: Camera): Signal<number> {
  const age = useSignal(0);
  useEffect(() => {
    const timer = setInterval(() => {
      const seconds = camera.takenAt.peek() ? (Date.now() - camera.takenAt.peek()) / 1000 : 0;
      age.value = seconds > OLD ? seconds : 0;
    }, LOOK);
    return () => clearInterval(timer);
  }, [age, camera]);
  return age;
}

/** The age of an old image; nothing for a fresh one. */
export function OldAge({ age }: { age: Signal<number> }) {
  const t = useTexts();
  if (age.value === 0) return null;
  return (
    <span part="age" class="image-age problem">
      {t("camera.old", { seconds: age.value.toFixed(1) })}
    </span>
  );
}
