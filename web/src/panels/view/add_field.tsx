/** A form that adds a field of a topic to a panel. */

import { useSignal } from "@preact/signals";
import { Plus } from "lucide";
import { useEffect } from "preact/hooks";
import { Icon } from "../../forms/icon";
import { Suggest } from "../../forms/suggest";
import { t } from "../../i18n/text";
import { numericPaths } from "../../robot/fields";
import { FUNCTIONS, formulaProblem } from "../../robot/formula";
import type { Message } from "../../robot/subscriptions";
import { useMessages } from "../component";
import type { PanelContext } from "../registry";

/** Field of a topic; its path may end with functions. */
export interface Field {
  topic: string;
  path: string;
}

/** Milliseconds between two messages that are looked at. */
const THROTTLE = 500;

/** `pathsOf` finds the fields of a message that can be chosen. */
export function AddField(props: {
  context: PanelContext;
  pathsOf?: (message: Message) => string[];
  /** Name of the button. */
  name?: string;
  onAdd: (field: Field) => void;
}) {
  const { context, pathsOf = numericPaths, name = t("plot.add"), onAdd } = props;
  const { session } = context;
  const topic = useSignal("");
  const path = useSignal("");
  const sample = useSignal<Message | null>(null);
  const { topics } = session.graph.value;
  const chosen = topics.has(topic.value) && session.may("subscribe", topic.value) ? topic.value : "";
  useEffect(() => {
    sample.value = null;
  }, [chosen, sample]);
  const take = (message: Message) => {
    sample.value ??= message;
  };
  useMessages(session, chosen, take, { throttle: THROTTLE });
  const names = [...topics.keys()].filter((each) => session.may("subscribe", each)).sort();
  const paths = sample.value ? pathsOf(sample.value) : [];
  const at = path.value.indexOf("@");
  // After an @, functions are offered for what stands before it.
  const options = at < 0 ? paths : FUNCTIONS.map((each) => path.value.slice(0, at) + each);
  const problem = formulaProblem(path.value);
  return (
    <form
      class="add-field"
      onSubmit={(event) => {
        event.preventDefault();
        if (!chosen || !path.value || problem) return;
        onAdd({ topic: chosen, path: path.value });
        path.value = "";
      }}
    >
      <Suggest
        label={t("panel.topic")}
        value={topic.value}
        options={names}
        onInput={(value) => {
          topic.value = value;
          path.value = "";
        }}
      />
      <Suggest
        label={t("plot.field")}
        value={path.value}
        options={options}
        disabled={!chosen}
        onInput={(value) => {
          path.value = value;
        }}
      />
      <button type="submit" disabled={!chosen || !path.value || problem !== ""}>
        <Icon of={Plus} size={16} /> {name}
      </button>
      {path.value.endsWith(")") && problem && <span class="problem">{problem}</span>}
    </form>
  );
}
