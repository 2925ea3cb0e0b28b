/** Kind of the panel of frames; the panel itself is loaded when the first one opens. */

import { shortType } from "../../robot/names";
import { laterPanel } from "../component";
import type { PanelKind } from "../registry";

export const frames: PanelKind = {
  name: "frames",
  title: "frames.title",
  supportedTypes: ["tf2_msgs/TFMessage", "tf/tfMessage"],
  opens: (session) => shortType(session.graph.value.topics.get("/tf") ?? "").endsWith("TFMessage"),
  place: "below",
  init: laterPanel(() => import("./frames_panel")),
};
