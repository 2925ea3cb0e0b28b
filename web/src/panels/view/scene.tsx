/** The 3D scene: the robot and what it sees, with tools to send it somewhere. It is loaded when it opens. */

import { useSignal } from "@preact/signals";
import type { ComponentType } from "preact";
import { useLater } from "../../forms/later";
import { Problem } from "../../forms/problem";
import { componentPanel } from "../component";
import type { PanelContext, PanelKind } from "../registry";

/** Types that are worth a scene; the scene itself draws more. */
const TYPES = [
  "nav_msgs/OccupancyGrid",
  "sensor_msgs/LaserScan",
  "sensor_msgs/PointCloud2",
  "nav_msgs/Odometry",
];

export const scene: PanelKind = {
  name: "scene",
  title: "scene.title",
  supportedTypes: TYPES,
  opens: (session) =>
    session.topicsOf(...TYPES).length > 0 || session.graph.value.topics.has("/robot_description"),
  place: "main",
  init: componentPanel(ScenePanel),
};

function ScenePanel({ context }: { context: PanelContext }) {
  const Stage = useSignal<ComponentType<{ context: PanelContext }> | null>(null);
  const problem = useLater(
    () => import("../scene/stage"),
    (module) => {
      Stage.value = module.Stage;
      return undefined;
    },
    [context],
  );
  return (
    <>
      {problem && <Problem text={problem} />}
      {Stage.value && <Stage.value context={context} />}
    </>
  );
}
