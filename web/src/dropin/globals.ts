/**
 * What the drop-ins take from a page: the scripts that it has loaded before theirs leave globals, `ROSLIB` (roslib 1 or
 * 2), `ROS2D` and `createjs`. Only the parts of them that the drop-ins use are typed here.
 */

export type Listener = (...values: never[]) => void;

/** A connection, `ROSLIB.Ros` of roslib 1 or 2. */
export interface Ros {
  readonly isConnected: boolean;
  on(event: string, listener: Listener): unknown;
  callOnConnection(message: object): void;
  /** The socket of roslib 1. */
  readonly socket?: EventTarget | null;
}

export interface Topic<Message> {
  subscribe(listener: (message: Message) => void): void;
  unsubscribe(): void;
  publish(message: Message): void;
}

export interface Goal {
  send(): void;
  cancel(): void;
  on(event: string, listener: Listener): unknown;
}

export interface Vector3 {
  x: number;
  y: number;
  z: number;
}

export interface Quaternion extends Vector3 {
  w: number;
}

export interface Pose {
  position: Vector3;
  orientation: Quaternion;
}

interface Action {
  sendGoal(
    goal: object,
    onResult: (result: object) => void,
    onFeedback: undefined,
    onFailure: (reason: string) => void,
  ): string | undefined;
  cancelGoal(id: string): void;
}

interface Roslib {
  Topic: new <Message>(options: object) => Topic<Message>;
  Service: new (
    options: object,
  ) => {
    callService(
      request: object,
      onAnswer: (answer: never) => void,
      onFailure: (reason: string) => void,
    ): void;
  };
  ActionClient: new (options: object) => object;
  Goal: new (options: object) => Goal;
  /** In roslib 2 alone. */
  Action?: new (
    options: object,
  ) => Action;
}

/** A `createjs.DisplayObject`. */
export interface DisplayObject {
  x: number;
  y: number;
  rotation: number;
  scaleX: number;
  scaleY: number;
  visible: boolean;
}

/** A `createjs.Shape`. */
export interface Shape extends DisplayObject {
  readonly graphics: {
    setStrokeStyle(thickness: number): Shape["graphics"];
    beginStroke(colour: string): Shape["graphics"];
    beginFill(colour: string): Shape["graphics"];
    moveTo(x: number, y: number): Shape["graphics"];
    lineTo(x: number, y: number): Shape["graphics"];
    closePath(): Shape["graphics"];
  };
  addEventListener(type: "tick", listener: () => void): void;
}

/** A `createjs.Container`. */
export interface Container extends DisplayObject {
  addChild(child: DisplayObject): void;
  removeChild(child: DisplayObject): void;
  addEventListener(type: string, listener: (event: StageEvent) => void): void;
  readonly stage: Stage | null;
}

/** A `createjs.Stage` with what ros2d adds to it. */
export interface Stage extends Container {
  globalToRos(x: number, y: number): Vector3;
  rosQuaternionToGlobalTheta(orientation: Quaternion): number;
}

/** A `createjs.MouseEvent`. */
export interface StageEvent {
  stageX: number;
  stageY: number;
}

interface Createjs {
  Stage: new (canvas: HTMLCanvasElement) => Stage;
  Container: new () => Container;
  Shape: new () => Shape;
  Graphics: { getRGB(red: number, green: number, blue: number, alpha: number): string };
}

/** A `ROS2D.OccupancyGrid` or `ROS2D.ImageMap`: sizes in metres. */
export interface MapImage {
  width: number;
  height: number;
  pose: { position: { x: number; y: number } };
}

/** A `ROS2D.OccupancyGridClient` (`currentGrid`) or `ROS2D.ImageMapClient` (`currentImage`). */
export interface MapClient {
  on(event: "change", listener: () => void): unknown;
  currentGrid?: MapImage;
  currentImage?: MapImage;
}

/** A `ROS2D.Viewer`. */
export interface Viewer {
  scaleToDimensions(width: number, height: number): void;
  shift(x: number, y: number): void;
}

interface Ros2d {
  OccupancyGridClient: new (options: object) => MapClient;
  ImageMapClient: new (options: object) => MapClient;
  NavigationImage: new (options: object) => DisplayObject;
}

interface Globals {
  ROSLIB: Roslib;
  ROS2D: Ros2d;
  createjs: Createjs;
}

const SCRIPTS: Record<keyof Globals, string> = {
  ROSLIB: "roslib.min.js",
  ROS2D: "ros2d.min.js",
  createjs: "easeljs.min.js",
};

/** A global that another script has made; an error that names the script where it has not. */
export function pageGlobal<Name extends keyof Globals>(name: Name): Globals[Name] {
  const found = (globalThis as unknown as Partial<Globals>)[name];
  if (found === undefined) {
    throw new Error(`${name} is not there: the page has to load ${SCRIPTS[name]} before this script`);
  }
  return found;
}
