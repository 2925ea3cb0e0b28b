/** Kind of the plot panel; the panel itself is loaded when the first one opens. */

import { laterPanel } from "../component";
import type { PanelKind } from "../registry";

const TYPES = ["nav_msgs/Odometry", "std_msgs/Float64", "std_msgs/Float32"];

export const plot: PanelKind = {
  name: "plot",
  title: "plot.title",
  supportedTypes: TYPES,
  opens: (session) => session.topicsOf(...TYPES).length > 0,
  place: "below",
  init: laterPanel(() => import("./plot_panel")),
};
