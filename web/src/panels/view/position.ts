/** Position by satellite; the panel is loaded when it opens. */

import { laterPanel } from "../component";
import { hasTopics, type PanelKind } from "../registry";

export const position: PanelKind = {
  name: "position",
  title: "position.title",
  supportedTypes: ["sensor_msgs/NavSatFix"],
  opens: (session) => hasTopics(position, session),
  place: "below",
  init: laterPanel(() => import("./position_panel")),
};
