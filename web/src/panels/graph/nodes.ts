/** Kind of the panel of nodes; the panel itself is loaded when the first one opens. */

import { laterPanel } from "../component";
import type { PanelKind } from "../registry";

export const nodes: PanelKind = {
  name: "nodes",
  title: "nodes.title",
  supportedTypes: [],
  opens: (session) => session.graph.value.nodes.length > 0,
  place: "below",
  init: laterPanel(() => import("./nodes_panel")),
};
