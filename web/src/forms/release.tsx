/** The control that releases the stop: it is held for a second, so that no double press on the stop releases it. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { useTexts } from "../i18n/context";
import { holdHandlers } from "./hold";

/** Milliseconds for which the control is held. */
const HOLD = 1000;

/** Button that calls `onRelease` once it was held by a pointer, Enter or the space bar. */
export function ReleaseButton({ onRelease }: { onRelease: () => void }) {
  const t = useTexts();
  const holding = useSignal(false);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const letGo = () => {
    clearTimeout(timer.current);
    holding.value = false;
  };
  const hold = () => {
    letGo();
    holding.value = true;
    timer.current = setTimeout(() => {
      letGo();
      onRelease();
    }, HOLD);
  };
  useEffect(() => letGo, []);
  return (
    <button
      type="button"
      part="release"
      class={holding.value ? "release holding" : "release"}
      data-scan="hold"
      {...holdHandlers(hold, letGo)}
    >
      {t("stop.release")}
    </button>
  );
}
