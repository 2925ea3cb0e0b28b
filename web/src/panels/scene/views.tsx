/** Views of the scene: a cube that shows and sets the direction, saved views, and the meaning of colours. */

import { useSignal } from "@preact/signals";
import { Bookmark } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { Vector3 } from "three";
import { TextField } from "../../forms/inputs";
import { Menu } from "../../forms/menu";
import { t } from "../../i18n/text";
import type { RobotScene } from "../../scene/scene";
import type { PanelContext } from "../registry";

/** Sides of the cube: where the camera goes, and which way is up on the side. */
const SIDES = [
  { name: "top", normal: new Vector3(0, 0, 1), up: new Vector3(1, 0, 0) },
  { name: "front", normal: new Vector3(1, 0, 0), up: new Vector3(0, 0, 1) },
  { name: "back", normal: new Vector3(-1, 0, 0), up: new Vector3(0, 0, 1) },
  { name: "left", normal: new Vector3(0, 1, 0), up: new Vector3(0, 0, 1) },
  { name: "right", normal: new Vector3(0, -1, 0), up: new Vector3(0, 0, 1) },
] as const;
/** Pixels from the cube's centre to a side. */
const HALF = 22;
/** Height from which a side is looked at, so that the ground can be seen. */
const RAISED = 0.15;

export function ViewCube({ scene }: { scene: RobotScene }) {
  const sides = useRef<(HTMLButtonElement | null)[]>([]);
  const { view } = scene;
  useEffect(() => {
    const turn = () => {
      const inverse = view.camera.matrixWorldInverse;
      SIDES.forEach(({ normal, up }, at) => {
        const out = normal.clone().transformDirection(inverse);
        const down = up.clone().negate().transformDirection(inverse);
        const across = new Vector3().crossVectors(out, down);
        // A style sheet's y goes down.
        const column = ({ x, y, z }: Vector3, size = 1) => [x * size, -y * size, z * size];
        const matrix = [...column(across), 0, ...column(down), 0, ...column(out), 0, ...column(out, HALF), 1];
        const side = sides.current[at];
        side?.style.setProperty("transform", `matrix3d(${matrix.map((each) => each.toFixed(4)).join()})`);
        // The keyboard comes only to what is seen.
        if (side) side.tabIndex = out.z > 0.05 ? 0 : -1;
      });
    };
    view.camera.updateMatrixWorld();
    turn();
    const change = () => {
      view.camera.updateMatrixWorld();
      turn();
    };
    view.controls.addEventListener("change", change);
    return () => view.controls.removeEventListener("change", change);
  }, [view]);
  return (
    <fieldset class="view-cube" aria-label={t("scene.cube")}>
      {SIDES.map(({ name, normal: { x, y, z } }, at) => (
        <button
          key={name}
          type="button"
          ref={(element) => {
            sides.current[at] = element;
          }}
          onClick={() => view.lookAlong(x, y, z || RAISED)}
        >
          {t(`scene.cube.${name}`)}
        </button>
      ))}
    </fieldset>
  );
}

interface SavedView {
  name: string;
  at: number[];
}

const MOST_VIEWS = 20;

export function SavedViews({ context, scene }: { context: PanelContext; scene: RobotScene }) {
  const { config } = context;
  const views = (config.value.views ?? []) as SavedView[];
  const name = useSignal("");
  const set = (changed: readonly SavedView[]) => {
    config.value = { ...config.value, views: changed };
  };
  return (
    <Menu label={t("scene.views")} icon={Bookmark}>
      {(close) => (
        <>
          <ul>
            {views.map((each) => (
              <li key={each.name} class="pair">
                <button
                  type="button"
                  onClick={() => {
                    scene.view.viewpoint = each.at;
                    close();
                  }}
                >
                  {each.name}
                </button>
                <button
                  type="button"
                  aria-label={t("layout.delete", { name: each.name })}
                  onClick={() => set(views.filter((other) => other !== each))}
                >
                  ×
                </button>
              </li>
            ))}
          </ul>
          <form
            onSubmit={(event) => {
              event.preventDefault();
              const wanted = name.value.trim() || t("scene.view", { number: views.length + 1 });
              const others = views.filter((each) => each.name !== wanted);
              set([...others, { name: wanted, at: scene.view.viewpoint }].slice(-MOST_VIEWS));
              name.value = "";
            }}
          >
            <TextField label={t("layout.name")} text={name} />
            <button type="submit">{t("scene.view.save")}</button>
          </form>
        </>
      )}
    </Menu>
  );
}

const MOST_LEGENDS = 3;

/** The colours of layers and the values that they stand for. */
export function Legends({ scene }: { scene: RobotScene }) {
  const shown = scene.rows.value.flatMap(({ topic, layer }) => {
    const legend = layer?.legend.value;
    return legend ? [{ topic, legend }] : [];
  });
  if (!shown.length) return null;
  return (
    <dl class="legends">
      {shown.slice(0, MOST_LEGENDS).map(({ topic, legend: { palette, by, range } }) => (
        <div key={topic}>
          <dt>
            {topic} <span class="faint">{by}</span>
          </dt>
          <dd>
            <span class={`palette palette-${palette}`} />
            <span class="legend-range">
              <span>{Number(range[0].toPrecision(3))}</span>
              <span>{Number(range[1].toPrecision(3))}</span>
            </span>
          </dd>
        </div>
      ))}
    </dl>
  );
}
