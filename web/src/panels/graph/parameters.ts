/** Kind of the panel of parameters; the panel itself is loaded when the first one opens. */

import { laterPanel } from "../component";
import type { PanelKind } from "../registry";

export const parameters: PanelKind = {
  name: "parameters",
  title: "parameters.title",
  supportedTypes: [],
  opens: (session) => session.graph.value.services.includes("/rosapi/get_param_names"),
  place: "below",
  init: laterPanel(() => import("./parameters_panel")),
};
