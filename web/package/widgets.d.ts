/** The elements of `@robot-web-tools/widgets`, as TypeScript knows them; importing the package defines their tags. */

/** Members common to all elements. */
export interface RobotElement extends HTMLElement {
  /** The WebSocket URL of the robot; empty for the server that the script or the page came from. */
  robot: string;
}

/** `<rwt-video>`: a camera. */
export interface VideoElement extends RobotElement {
  /** A topic of pictures; empty for the first that there is. */
  topic: string;
  /** Alternative text of the picture. */
  label: string;
  /** True if the rate and transport of the pictures are shown below them. */
  details: boolean;
  /** The picture that is shown, as a PNG; null before the first. */
  still(): Promise<Blob | null>;
}

/** `<rwt-teleop>`: a stick, buttons and keys that drive the robot while they are held. */
export interface TeleopElement extends RobotElement {
  /** Where velocities go; empty for the likeliest topic that the robot has. */
  topic: string;
  /** Metres per second at full deflection, 0 to 20. */
  maxLinear: number;
  /** Radians per second at full deflection, 0 to 20. */
  maxAngular: number;
  /** When keys drive: while the focus is in the element, from anywhere in the page, or never. */
  keys: "focus" | "page" | "off";
  /** Shown controls. */
  controls: "all" | "stick" | "buttons";
}

/** `<rwt-stop>`: a button that stops the robot in software, and keeps the page's controls from moving it. */
export interface StopElement extends RobotElement {
  /** A key that stops from anywhere in the page, as `Escape`. */
  shortcut: string;
  /** True if the state is not shown beside the button. */
  quiet: boolean;
  /** True if the controls of the page are kept from moving the robot. */
  readonly stopped: boolean;
  /** Stop the robot. */
  stop(): void;
  /** Let the controls of the page work again; nothing moves by that. */
  release(): void;
}

/** `<rwt-scene>`: the robot in three dimensions, with everything that can be drawn. */
export interface SceneElement extends RobotElement {
  /** The topics that are drawn, with blanks between them; empty for what can be drawn and is not large. */
  layers: string;
  /** The frame that stands still; empty for the map's. */
  frame: string;
  /** True if the view stays with the robot. */
  follow: boolean;
  /** True if there is a button for sending the robot somewhere. */
  goals: boolean;
  /** Origins besides the robot's server that meshes may come from, with blanks between them. */
  meshOrigins: string;
}

/** `<rwt-map>`: the robot on its map, from above. */
export interface MapElement extends SceneElement {}

/** `<rwt-plot>`: numbers over time. */
export interface PlotElement extends RobotElement {
  topic: string;
  /** The paths of the values, with blanks between them, as `linear.x ranges[0]`. */
  field: string;
  /** Shown time span in seconds, 1 to 3600. */
  seconds: number;
  /** Most messages a second, 0.1 to 1000. */
  rate: number;
  /** True if the picture stands still. */
  paused: boolean;
  /** The least and the greatest value of the axis, as `-1 1`; empty for what fits. */
  range: string;
  /** Title of the plot; empty for its topic. */
  label: string;
  /** Shown values as CSV: seconds since 1970, and the values. */
  csv(): string;
}

/** `<rwt-topic>`: what a topic says last, or one value of it. */
export interface TopicElement extends RobotElement {
  topic: string;
  /** The path of the value, as `pose.pose.position.x`; empty for the whole message. */
  field: string;
  /** Digits after the point, 0 to 15. */
  digits: number;
  /** Most messages a second, 0.1 to 60. */
  rate: number;
}

/** `<rwt-battery>`: how full it is. */
export interface BatteryElement extends RobotElement {
  /** A topic of `sensor_msgs/BatteryState`; empty for the first that there is. */
  topic: string;
  /** Percent below which it is low. */
  low: number;
}

type Class<Element> = { new (): Element; prototype: Element };

export const VideoElement: Class<VideoElement>;
export const TeleopElement: Class<TeleopElement>;
export const StopElement: Class<StopElement>;
export const SceneElement: Class<SceneElement>;
export const MapElement: Class<MapElement>;
export const PlotElement: Class<PlotElement>;
export const TopicElement: Class<TopicElement>;
export const BatteryElement: Class<BatteryElement>;

declare global {
  interface HTMLElementTagNameMap {
    "rwt-video": VideoElement;
    "rwt-teleop": TeleopElement;
    "rwt-stop": StopElement;
    "rwt-scene": SceneElement;
    "rwt-map": MapElement;
    "rwt-plot": PlotElement;
    "rwt-topic": TopicElement;
    "rwt-battery": BatteryElement;
  }

  interface HTMLElementEventMap {
    /** `<rwt-video>`: there is a new picture. */
    "rwt-picture": CustomEvent<{ topic: string }>;
    /** `<rwt-teleop>`: a control was taken. */
    "rwt-hold": CustomEvent<{ topic: string }>;
    /** `<rwt-teleop>`: the last control was let go (`topic`). `<rwt-stop>`: the controls work again (null). */
    "rwt-release": CustomEvent<{ topic: string } | null>;
    /** `<rwt-teleop>`: a velocity was sent, in m/s and rad/s. */
    "rwt-drive": CustomEvent<{ topic: string; linear: number; lateral: number; angular: number }>;
    /** `<rwt-stop>`: the robot was stopped. */
    "rwt-stop": CustomEvent<null>;
    /** `<rwt-map>`, `<rwt-scene>`: the robot was sent somewhere, in metres and radians. */
    "rwt-goal": CustomEvent<{ x: number; y: number; yaw: number; frame: string }>;
    /** `<rwt-map>`, `<rwt-scene>`: how that ended. */
    "rwt-goal-end": CustomEvent<{ outcome: string }>;
    /** `<rwt-topic>`: what the topic says. */
    "rwt-message": CustomEvent<{ topic: string; message: unknown }>;
    /** `<rwt-battery>`: the battery has become low, in percent. */
    "rwt-low": CustomEvent<{ percentage: number }>;
  }
}
