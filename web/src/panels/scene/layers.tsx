/** The list of layers, and how each is drawn. */

import { useSignal } from "@preact/signals";
import { SlidersHorizontal } from "lucide";
import type { ComponentChildren } from "preact";
import { Icon } from "../../forms/icon";
import { Check, Choice } from "../../forms/inputs";
import { t } from "../../i18n/text";
import { shortType } from "../../robot/names";
import { USUAL_AXES } from "../../scene/layers/frame_axes";
import type { LayerOption, LayerSettings } from "../../scene/layers/layer";
import { QUALITIES } from "../../scene/quality";
import type { LayerRow, RobotScene } from "../../scene/scene";
import type { PanelContext } from "../registry";

/** Options of the frames' axes, in the form of a layer's. */
const AXES: readonly LayerOption[] = [
  { kind: "switch", name: "axes", usual: USUAL_AXES.axes },
  { kind: "switch", name: "names", usual: USUAL_AXES.names },
  { kind: "switch", name: "ages", usual: USUAL_AXES.ages },
  { kind: "number", name: "size", least: 0.05, most: 2, step: 0.05, unit: "m", usual: USUAL_AXES.size },
];

/** A box for each topic that can be drawn, with its settings, and how finely all is drawn. */
export function LayerList({ context, scene }: { context: PanelContext; scene: RobotScene }) {
  const { config } = context;
  const open = useSignal("");
  const all = config.value.layerSettings as Record<string, LayerSettings> | undefined;
  const fold = (name: string) => {
    open.value = open.value === name ? "" : name;
  };
  return (
    <>
      <ul class="layers">
        {scene.rows.value.map((row) => (
          <LayerItem
            key={row.topic}
            context={context}
            row={row}
            isOpen={open.value === row.topic}
            onFold={() => fold(row.topic)}
          >
            <Options
              options={row.layer?.options.value ?? []}
              settings={all?.[row.topic] ?? {}}
              onChange={(settings) => {
                config.value = { ...config.value, layerSettings: { ...all, [row.topic]: settings } };
              }}
            />
          </LayerItem>
        ))}
        <li>
          <div class="layer">
            <span>{t("frames.title")}</span>
            <Gear name={t("frames.title")} isOpen={open.value === "frames"} onFold={() => fold("frames")} />
          </div>
          {open.value === "frames" && (
            <Options
              options={AXES}
              settings={(config.value.axes ?? {}) as LayerSettings}
              onChange={(axes) => {
                config.value = { ...config.value, axes };
              }}
            />
          )}
        </li>
      </ul>
      <Choice
        label={t("scene.quality")}
        chosen={String(config.value.quality ?? "auto")}
        options={QUALITIES.map((each) => [each, t(`scene.quality.${each}`)])}
        onChoose={(quality) => {
          config.value = { ...config.value, quality };
        }}
      />
    </>
  );
}

function LayerItem(props: {
  context: PanelContext;
  row: LayerRow;
  isOpen: boolean;
  onFold: () => void;
  children: ComponentChildren;
}) {
  const { row, isOpen, onFold, children } = props;
  const { config } = props.context;
  const { topic, type, layer } = row;
  const chosen = config.value.layers as Record<string, boolean> | undefined;
  const oneOf = layer?.oneOf.value ?? 1;
  return (
    <li>
      <div class="layer">
        <Check
          // The scene follows a choice only after this render.
          checked={chosen?.[topic] ?? layer !== null}
          onChange={(checked) => {
            const layers = config.peek().layers as Record<string, boolean> | undefined;
            config.value = { ...config.peek(), layers: { ...layers, [topic]: checked } };
          }}
        >
          {topic} <span class="faint">{shortType(type).split("/")[1]}</span>
          {oneOf > 1 && <span class="faint"> {t("scene.thinned", { count: oneOf })}</span>}
        </Check>
        {layer !== null && layer.options.value.length > 0 && (
          <Gear name={topic} isOpen={isOpen} onFold={onFold} />
        )}
      </div>
      {isOpen && layer !== null && children}
    </li>
  );
}

function Gear({ name, isOpen, onFold }: { name: string; isOpen: boolean; onFold: () => void }) {
  return (
    <button
      type="button"
      class="gear"
      aria-expanded={isOpen}
      aria-label={t("scene.settings", { name })}
      title={t("scene.settings", { name })}
      onClick={onFold}
    >
      <Icon of={SlidersHorizontal} size={16} />
    </button>
  );
}

function Options(props: {
  options: readonly LayerOption[];
  settings: LayerSettings;
  onChange: (settings: LayerSettings) => void;
}) {
  const { options, settings, onChange } = props;
  return (
    <div class="layer-options">
      {options.map((option) => (
        <Option
          key={option.name}
          option={option}
          value={settings[option.name] ?? option.usual}
          onChange={(value) => onChange({ ...settings, [option.name]: value })}
        />
      ))}
    </div>
  );
}

function Option(props: {
  option: LayerOption;
  value: string | number | boolean;
  onChange: (value: string | number | boolean) => void;
}) {
  const { option, value, onChange } = props;
  const label = option.label ?? t(`scene.option.${option.name as "size"}`);
  if (option.kind === "switch") {
    return (
      <Check checked={value === true} onChange={onChange}>
        {label}
      </Check>
    );
  }
  if (option.kind === "choice") {
    const shown = (each: string) =>
      NAMED.includes(each as (typeof NAMED)[number])
        ? t(`scene.value.${each as (typeof NAMED)[number]}`)
        : each;
    return (
      <Choice
        label={label}
        chosen={String(value)}
        options={option.values.map((each) => [each, shown(each)])}
        onChoose={onChange}
      />
    );
  }
  return (
    <label class="choice">
      <span>{label}</span>
      <input
        type="range"
        min={option.least}
        max={option.most}
        step={option.step}
        value={Number(value)}
        onInput={(event) => onChange(Number(event.currentTarget.value))}
      />
      <output class="number">
        {Number(value)} {option.unit}
      </output>
    </label>
  );
}

/** Values that are words of the page; all others are names of fields and palettes. */
const NAMED = ["auto", "flat", "range", "arrow", "axes", "map", "costmap", "grey"] as const;
