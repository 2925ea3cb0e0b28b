/** State of the page's last goal, and a button that cancels it. */

import { useRef } from "preact/hooks";
import { useTexts } from "../../i18n/context";
import type { Navigation } from "../../robot/navigation";

export function NavigationState({ navigation }: { navigation: Navigation }) {
  const t = useTexts();
  const state = useRef<HTMLParagraphElement>(null);
  const progress = navigation.progress.value;
  if (!progress) return null;
  const { place, outcome, distance, remaining, text } = progress;
  const where = `${place.x.toFixed(2)}, ${place.y.toFixed(2)}`;
  return (
    <p class={`goal-state goal-${outcome ?? "underway"}`} role="status" tabIndex={-1} ref={state}>
      {outcome === null ? t("goal.underway", { where }) : t(`goal.${outcome}`, { where })}
      {outcome === null && Number.isFinite(distance) && ` · ${distance.toFixed(1)} m`}
      {outcome === null && Number.isFinite(remaining) && ` · ${remaining.toFixed(0)} s`}
      {text && ` · ${text}`}
      {outcome === null && (
        <button
          type="button"
          data-scan="press"
          onClick={() => {
            navigation.cancel();
            // The button goes with the goal: the keyboard stays where it was.
            state.current?.focus({ preventScroll: true });
          }}
        >
          {t("goal.cancel")}
        </button>
      )}
    </p>
  );
}
