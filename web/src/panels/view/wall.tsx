/** Several cameras side by side. */

import { Check } from "../../forms/inputs";
import { t } from "../../i18n/text";
import { CAMERA_TYPES, cameraTopics } from "../../robot/camera";
import { componentPanel, Needs } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { View } from "./camera";

/** Cameras at a time, in three rows of three. */
const MOST = 9;
/** Cameras by streams over HTTP, of which a browser opens six at a server; the others come as messages. */
const MOST_STREAMS = 4;

export const wall: PanelKind = {
  name: "wall",
  title: "wall.title",
  supportedTypes: CAMERA_TYPES,
  opens: () => false,
  place: "main",
  init: componentPanel(WallPanel),
};

function WallPanel({ context }: { context: PanelContext }) {
  const { session, config, visible } = context;
  const topics = cameraTopics(session);
  // The same camera in another encoding is not shown by itself.
  const usual = topics.filter((topic) => !/encoded$|\/compressed$/.test(topic));
  const chosen = ((config.value.topics as string[] | undefined) ?? usual).slice(0, MOST);
  if (!topics.length) return <Needs kind={wall} />;
  return (
    <div class="wall">
      <details>
        <summary>{t("wall.choose", { count: chosen.length, most: MOST })}</summary>
        {topics.map((topic) => (
          <Check
            key={topic}
            checked={chosen.includes(topic)}
            disabled={!chosen.includes(topic) && chosen.length >= MOST}
            onChange={(checked) => {
              const rest = chosen.filter((each) => each !== topic);
              config.value = { ...config.value, topics: checked ? [...rest, topic] : rest };
            }}
          >
            {topic}
          </Check>
        ))}
      </details>
      <div class={`wall-grid columns-${Math.ceil(Math.sqrt(chosen.length))}`}>
        {visible.value &&
          session.hasAsked &&
          chosen.map((topic, at) => (
            <figure key={topic} class="camera">
              <View context={context} topic={topic} options={{ messages: at >= MOST_STREAMS }} />
              <figcaption>{topic}</figcaption>
            </figure>
          ))}
      </div>
    </div>
  );
}
