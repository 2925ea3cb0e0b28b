/** Details of what was clicked in the scene. */

import { type Signal, useSignal } from "@preact/signals";
import { X } from "lucide";
import { useEffect, useMemo } from "preact/hooks";
import { Vector3 } from "three";
import { Icon } from "../../forms/icon";
import { t } from "../../i18n/text";
import { shortType } from "../../robot/names";
import type { Place } from "../../robot/navigation";
import type { Picked, RobotScene } from "../../scene/scene";

/** Pixels that the pointer may go while a click is made. */
const STILL = 4;

export interface DetailsState {
  picked: Signal<Picked | null>;
  /** Look for what is drawn at a place on the ground. */
  inspect(place: Place): void;
}

/** What was clicked last, with the tool for it or without any. */
export function useDetails(scene: RobotScene): DetailsState {
  const picked = useSignal<Picked | null>(null);
  const { view, tools } = scene;
  useEffect(() => {
    const { canvas } = view;
    let from = { x: 0, y: 0 };
    const down = ({ clientX: x, clientY: y }: PointerEvent) => {
      from = { x, y };
    };
    const click = ({ clientX: x, clientY: y }: MouseEvent) => {
      if (tools.chosen.peek() !== "look" || Math.hypot(x - from.x, y - from.y) > STILL) return;
      if (!scene.menu.peek()) picked.value = scene.pick(x, y);
    };
    canvas.addEventListener("pointerdown", down);
    canvas.addEventListener("click", click);
    return () => {
      canvas.removeEventListener("pointerdown", down);
      canvas.removeEventListener("click", click);
    };
  }, [scene, view, tools, picked]);
  return useMemo(
    () => ({
      picked,
      inspect: ({ x, y }) => {
        const at = view.pixel(new Vector3(x, y, 0));
        picked.value = scene.pick(at.x, at.y);
      },
    }),
    [scene, view, picked],
  );
}

export function Details({ scene, details: { picked } }: { scene: RobotScene; details: DetailsState }) {
  const shown = picked.value;
  if (!shown) return null;
  const { topic, type, layer, point, rows } = shown;
  const robot = scene.robotPlace;
  const all = [
    ...rows.map(([name, value]) => [t(name), value]),
    [
      t("scene.at", { frame: scene.frames.fixed.value || "–" }),
      [point.x, point.y, point.z].map((each) => each.toFixed(2)).join(", "),
    ],
    [t("scene.distance"), `${Math.hypot(point.x - robot.x, point.y - robot.y).toFixed(2)} m`],
    [t("goal.frame"), layer.frameName || "–"],
  ];
  return (
    <section class="scene-card details" aria-label={t("scene.details")} aria-live="polite">
      <header>
        <b>{topic}</b> <span class="faint">{shortType(type).split("/")[1]}</span>
        <button
          type="button"
          class="plain close"
          aria-label={t("scene.details.close")}
          onClick={() => {
            picked.value = null;
          }}
        >
          <Icon of={X} size={16} />
        </button>
      </header>
      <dl>
        {all.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
    </section>
  );
}
