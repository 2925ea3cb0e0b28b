/** Types that the scene can draw, known without loading it. */

import { shortType } from "../robot/names";

/** Types of messages that the scene draws, without `/msg/`. */
export const DRAWABLE_TYPES = [
  "nav_msgs/OccupancyGrid",
  "nav_msgs/Odometry",
  "nav_msgs/Path",
  "sensor_msgs/LaserScan",
  "sensor_msgs/PointCloud2",
  "geometry_msgs/PoseStamped",
  "geometry_msgs/PoseWithCovarianceStamped",
  "geometry_msgs/PoseArray",
  "visualization_msgs/Marker",
  "visualization_msgs/MarkerArray",
  "visualization_msgs/InteractiveMarkerUpdate",
] as const;

export type DrawableType = (typeof DRAWABLE_TYPES)[number];

/** Layers that are not shown until somebody asks: they cost much, or hide others. */
const HIDDEN = /depth|cost|\/points(?!\/decimated)|tunneled/;

/** Return true if a topic is the description of a robot. */
export function isDescription(topic: string, type: string): boolean {
  return shortType(type) === "std_msgs/String" && topic.endsWith("robot_description");
}

/** Return true if the scene can draw a topic. */
export function isDrawable(topic: string, type: string): boolean {
  if (topic.endsWith("/update_full")) return false;
  return isDescription(topic, type) || DRAWABLE_TYPES.includes(shortType(type) as DrawableType);
}

/** Return true if a topic is drawn, by choice or from the start. */
export function isDrawn(topic: string, wanted: Readonly<Record<string, boolean>> = {}): boolean {
  return wanted[topic] ?? !HIDDEN.test(topic);
}
