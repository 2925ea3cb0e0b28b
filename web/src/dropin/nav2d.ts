/** The global `NAV2D`: sends a robot to where its user clicks in a map of ros2d, as nav2djs did. */

import {
  type Container,
  type DisplayObject,
  type MapClient,
  type MapImage,
  type Pose,
  pageGlobal,
  type Quaternion,
  type Ros,
  type Shape,
  type Stage,
  type StageEvent,
  type Vector3,
  type Viewer,
} from "./globals";
import { NavigationGoals } from "./navigation_goals";

export const REVISION = "0.5.0";

/** A `ROSLIB.TFClient`, or one of roslib 2. */
interface TfClient {
  subscribe(
    frame: string,
    listener: (transform: { translation: Vector3; rotation: Quaternion }) => void,
  ): void;
}

export interface NavigatorOptions {
  ros: Ros;
  /** Where the robot's pose comes from; by default the topic of `robot_pose`. */
  tfClient?: TfClient | null;
  /** A topic of `geometry_msgs/Pose`, or with `tfClient` a frame; by default `/robot_pose`. */
  robot_pose?: string;
  /** The action to send goals to; by default `/move_base`, and `/navigate_to_pose` on ROS 2. */
  serverName?: string;
  /** Its type; by default `move_base_msgs/MoveBaseAction`, and `nav2_msgs/action/NavigateToPose` on ROS 2. */
  actionName?: string;
  /** Where clicks are taken and markers are drawn: the scene of a `ROS2D.Viewer`. */
  rootObject?: Container;
  /** True if the user drags to set the heading, instead of a double click. */
  withOrientation?: boolean | string;
  /** The URL of a picture to show in place of the arrows. */
  image?: string | false;
}

export interface MapNavOptions extends NavigatorOptions {
  viewer: Viewer;
  /** The topic of the map, or of its description. */
  topic?: string;
}

export interface OccupancyGridClientNavOptions extends MapNavOptions {
  /** Follow a map that grows. */
  continuous?: boolean;
}

export interface ImageMapClientNavOptions extends MapNavOptions {
  /** The URL of the map's picture; without it `image` is that. */
  image_map?: string;
}

const AHEAD: Quaternion = { x: 0, y: 0, z: 0, w: 1 };

const COLOURS = { robot: [255, 128, 0], goal: [255, 64, 128], direction: [0, 255, 0] } as const;

/** By how much of its size a marker grows while it pulses, and in how many milliseconds by a radian. */
const PULSE = 0.2;
const PULSE_TIME = 110;

/** A triangle whose tip is `size` pixels before its middle. */
function drawArrow(kind: keyof typeof COLOURS, size: number): Shape {
  const { Graphics, Shape } = pageGlobal("createjs");
  const [red, green, blue] = COLOURS[kind];
  const arrow = new Shape();
  arrow.graphics
    .setStrokeStyle(1)
    .beginStroke(Graphics.getRGB(0, 0, 0, 1))
    .beginFill(Graphics.getRGB(red, green, blue, 0.66))
    .moveTo(size, 0)
    .lineTo(-size / 2, size / 2)
    .lineTo(-size / 2, -size / 2)
    .closePath();
  return arrow;
}

class NavigatorPart {
  readonly rootObject: Container;
  /** Marker of the goal, while there is one. */
  goalMarker: DisplayObject | null = null;

  readonly #image: string | false;
  readonly #goals: NavigationGoals;
  readonly #robotMarker: DisplayObject;
  #direction: DisplayObject | null = null;
  #dragFrom: Vector3 | null = null;
  /** The scale of the stage for which the markers were made. */
  #scale = { x: 0, y: 0 };

  constructor(options: NavigatorOptions) {
    this.rootObject = options.rootObject ?? new (pageGlobal("createjs").Container)();
    this.#image = options.image || false;
    this.#goals = new NavigationGoals(options);
    this.#robotMarker = this.#marker("robot", 25, true);
    this.#robotMarker.visible = false;
    this.rootObject.addChild(this.#robotMarker);
    this.#followRobot(options);
    if (options.withOrientation) {
      this.rootObject.addEventListener("stagemousedown", (event) => this.#onDown(event));
      this.rootObject.addEventListener("stagemousemove", (event) => this.#onMove(event));
      this.rootObject.addEventListener("stagemouseup", (event) => this.#onUp(event));
    } else {
      this.rootObject.addEventListener("dblclick", (event) => this.#go(this.#toRos(event), AHEAD));
    }
  }

  /** Cancels the goal under way. */
  cancelGoal(): void {
    this.#goals.cancel();
  }

  /** Draws the markers in their size on the screen; to be called when the viewer shows another stretch of the map. */
  rescale(): void {
    const { scaleX, scaleY } = this.#stage;
    if (scaleX === this.#scale.x && scaleY === this.#scale.y) return;
    this.#scale = { x: scaleX, y: scaleY };
    for (const marker of [this.#robotMarker, this.goalMarker, this.#direction]) this.#fit(marker);
  }

  get #stage(): Stage {
    const { Stage } = pageGlobal("createjs");
    if (this.rootObject instanceof Stage) return this.rootObject;
    if (this.rootObject.stage === null)
      throw new Error("NAV2D: rootObject is on no stage; add it to one before");
    return this.rootObject.stage;
  }

  #marker(kind: keyof typeof COLOURS, size: number, pulse: boolean): DisplayObject {
    if (this.#image) {
      const { NavigationImage } = pageGlobal("ROS2D");
      return new NavigationImage({ size: 2.5, image: this.#image, alpha: kind === "robot" ? 1 : 0.7, pulse });
    }
    const arrow = drawArrow(kind, size);
    this.#fit(arrow);
    if (pulse) {
      const began = performance.now();
      arrow.addEventListener("tick", () => {
        this.#fit(arrow, 1 + PULSE * (1 - Math.cos((performance.now() - began) / PULSE_TIME)));
      });
    }
    return arrow;
  }

  /** Arrows have a size on the screen, pictures one in the map. */
  #fit(marker: DisplayObject | null, size = 1): void {
    if (marker === null || this.#image) return;
    const { scaleX, scaleY } = this.#stage;
    marker.scaleX = size / scaleX;
    marker.scaleY = size / scaleY;
  }

  #place(marker: DisplayObject, position: { x: number; y: number }, orientation: Quaternion): void {
    marker.x = position.x;
    marker.y = -position.y;
    marker.rotation = this.#stage.rosQuaternionToGlobalTheta(orientation);
  }

  #followRobot({ ros, tfClient, robot_pose: source = "/robot_pose" }: NavigatorOptions): void {
    const show = (position: Vector3, orientation: Quaternion) => {
      this.rescale();
      this.#place(this.#robotMarker, position, orientation);
      this.#robotMarker.visible = true;
    };
    if (tfClient) {
      tfClient.subscribe(source, ({ translation, rotation }) => show(translation, rotation));
      return;
    }
    const poses = new (pageGlobal("ROSLIB").Topic)<Pose>({
      ros,
      name: source,
      messageType: "geometry_msgs/Pose",
      throttle_rate: 100,
    });
    poses.subscribe(({ position, orientation }) => show(position, orientation));
  }

  #toRos(event: StageEvent): Vector3 {
    const { x, y } = this.#stage.globalToRos(event.stageX, event.stageY);
    return { x, y, z: 0 };
  }

  #go(position: Vector3, orientation: Quaternion): void {
    this.#clearGoal();
    const marker = this.#marker("goal", 15, true);
    this.goalMarker = marker;
    this.#place(marker, position, orientation);
    this.rootObject.addChild(marker);
    this.#goals.send({ position, orientation }, () => this.#clearGoal());
  }

  #clearGoal(): void {
    if (this.goalMarker !== null) this.rootObject.removeChild(this.goalMarker);
    this.goalMarker = null;
  }

  #onDown(event: StageEvent): void {
    this.#dragFrom = this.#toRos(event);
  }

  #onMove(event: StageEvent): void {
    if (this.#dragFrom === null) return;
    this.#clearDirection();
    const marker = this.#marker("direction", 25, false);
    this.#direction = marker;
    this.#place(marker, this.#dragFrom, this.#towards(this.#dragFrom, event));
    this.rootObject.addChild(marker);
  }

  #onUp(event: StageEvent): void {
    if (this.#dragFrom === null) return;
    const from = this.#dragFrom;
    this.#dragFrom = null;
    this.#clearDirection();
    this.#go(from, this.#towards(from, event));
  }

  #towards(from: Vector3, event: StageEvent): Quaternion {
    const to = this.#toRos(event);
    const half = Math.atan2(to.y - from.y, to.x - from.x) / 2;
    return { x: 0, y: 0, z: Math.sin(half), w: Math.cos(half) };
  }

  #clearDirection(): void {
    if (this.#direction !== null) this.rootObject.removeChild(this.#direction);
    this.#direction = null;
  }
}

class MapNavPart {
  readonly navigator: NavigatorPart;
  #shown: { width: number; height: number; x: number; y: number } | undefined;

  constructor(
    /** Client of the map. */
    readonly client: MapClient,
    options: MapNavOptions & { rootObject: Container },
  ) {
    this.navigator = new NavigatorPart(options);
    client.on("change", () => {
      const map = client.currentGrid ?? client.currentImage;
      if (map !== undefined) this.#fit(options.viewer, map);
    });
  }

  /** Has the viewer show all of the map. */
  #fit(viewer: Viewer, { width, height, pose: { position } }: MapImage): void {
    const shown = this.#shown;
    const { x, y } = position;
    if (shown?.width === width && shown.height === height && shown.x === x && shown.y === y) return;
    // Scaling takes back the last shift, so that each shift is from the map's origin.
    viewer.scaleToDimensions(width, height);
    viewer.shift(x, y);
    this.#shown = { width, height, x, y };
    this.navigator.rescale();
  }
}

function rootOf(options: NavigatorOptions): Container {
  return options.rootObject ?? new (pageGlobal("createjs").Container)();
}

// Pages call these with and without `new`.

/** Takes clicks on `rootObject`, shows the robot there, and sends it to where the user clicks. */
export function Navigator(options: NavigatorOptions): NavigatorPart {
  return new NavigatorPart(options);
}
Navigator.prototype = NavigatorPart.prototype;

/** A {@link Navigator} on a map from a topic of `nav_msgs/OccupancyGrid`, by default `/map`. */
export function OccupancyGridClientNav(options: OccupancyGridClientNavOptions): MapNavPart {
  const rootObject = rootOf(options);
  const { ros, continuous, topic = "/map" } = options;
  const client = new (pageGlobal("ROS2D").OccupancyGridClient)({ ros, rootObject, continuous, topic });
  return new MapNavPart(client, { ...options, rootObject });
}
OccupancyGridClientNav.prototype = MapNavPart.prototype;

/** A {@link Navigator} on a picture, of which a topic of `nav_msgs/MapMetaData` says the place, by default `/map_metadata`. */
export function ImageMapClientNav(options: ImageMapClientNavOptions): MapNavPart {
  const rootObject = rootOf(options);
  const { ros, topic = "/map_metadata", image_map, image } = options;
  const client = new (pageGlobal("ROS2D").ImageMapClient)({
    ros,
    rootObject,
    topic,
    image: image_map ?? image,
  });
  return new MapNavPart(client, {
    ...options,
    rootObject,
    image: image_map === undefined ? false : (image ?? false),
  });
}
ImageMapClientNav.prototype = MapNavPart.prototype;
