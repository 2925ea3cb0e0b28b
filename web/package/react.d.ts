/** The elements as React 19 knows them in TSX: `import type {} from "@robot-web-tools/widgets/react"` once. */

import type { DetailedHTMLProps, HTMLAttributes } from "react";
import type * as widgets from "./widgets.js";

type Events = {
  [Name in Extract<keyof HTMLElementEventMap, `rwt-${string}`> as `on${Name}`]?: (
    event: HTMLElementEventMap[Name],
  ) => void;
};

type Props<Element extends HTMLElement> = DetailedHTMLProps<HTMLAttributes<Element>, Element> &
  Partial<Omit<Element, keyof HTMLElement>> &
  Events;

declare module "react" {
  namespace JSX {
    interface IntrinsicElements {
      "rwt-video": Props<widgets.VideoElement>;
      "rwt-teleop": Props<widgets.TeleopElement>;
      "rwt-stop": Props<widgets.StopElement>;
      "rwt-scene": Props<widgets.SceneElement>;
      "rwt-map": Props<widgets.MapElement>;
      "rwt-plot": Props<widgets.PlotElement>;
      "rwt-topic": Props<widgets.TopicElement>;
      "rwt-battery": Props<widgets.BatteryElement>;
    }
  }
}
