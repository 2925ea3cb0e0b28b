/**
 * The elements for other people's pages. A page loads this script once, as a module; the robot that it came from is
 * the one that elements without the attribute `robot` show.
 */

export { BatteryElement } from "./battery/battery";
export { PlotElement } from "./plot/plot";
export { MapElement, SceneElement } from "./scene/scene";
export { StopElement } from "./stop/stop";
export { TeleopElement } from "./teleop/teleop";
export { TopicElement } from "./topic/topic";
export { VideoElement } from "./video/video";
