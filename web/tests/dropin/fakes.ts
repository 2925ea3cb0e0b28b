/** Stand-ins for what a page has loaded before a drop-in: ROSLIB, ROS2D and createjs, as far as those use them. */

import { vi } from "vitest";

export interface Published {
  topic: string;
  type: string;
  message: unknown;
}

type Listener = (...values: unknown[]) => void;

class Emitter {
  private readonly heard = new Map<string, Listener[]>();

  on(event: string, listener: Listener): void {
    this.heard.set(event, [...(this.heard.get(event) ?? []), listener]);
  }

  emit(event: string, ...values: unknown[]): void {
    for (const listener of this.heard.get(event) ?? []) listener(...values);
  }
}

/** A connection of roslib 1. */
export class FakeRos extends Emitter {
  isConnected = true;
  readonly socket = new EventTarget();
  readonly sent: { op: string; [key: string]: unknown }[] = [];

  callOnConnection(message: { op: string }): void {
    this.sent.push(message);
  }

  lose(): void {
    this.isConnected = false;
    this.emit("close");
  }

  receive(message: object): void {
    this.socket.dispatchEvent(new MessageEvent("message", { data: JSON.stringify(message) }));
  }
}

export class FakeGoal extends Emitter {
  readonly send = vi.fn();
  readonly cancel = vi.fn();

  constructor(readonly options: { actionClient: { options: object }; goalMessage: object }) {
    super();
    goals.push(this);
  }
}

export let published: Published[] = [];
export let goals: FakeGoal[] = [];
export let subscriptions = new Map<string, (message: unknown) => void>();

/** Installs ROSLIB; `version` is the generation of ROS that the robot's rosapi tells. */
export function installRoslib(version: 1 | 2): void {
  published = [];
  goals = [];
  subscriptions = new Map();
  class Topic {
    constructor(private readonly options: { name: string; messageType: string }) {}

    publish(message: unknown): void {
      published.push({ topic: this.options.name, type: this.options.messageType, message });
    }

    subscribe(listener: (message: unknown) => void): void {
      subscriptions.set(this.options.name, listener);
    }
  }
  class Service {
    callService(_request: object, onAnswer: (answer: object) => void, onFailure: (reason: string) => void) {
      if (version === 2) onAnswer({ version });
      else onFailure("no such service");
    }
  }
  class ActionClient {
    constructor(readonly options: object) {}
  }
  vi.stubGlobal("ROSLIB", { Topic, Service, ActionClient, Goal: FakeGoal });
}

export class FakeContainer extends Emitter {
  readonly children: object[] = [];
  stage: FakeStage | null = null;

  addChild(child: object): void {
    this.children.push(child);
  }

  removeChild(child: object): void {
    const at = this.children.indexOf(child);
    if (at >= 0) this.children.splice(at, 1);
  }

  addEventListener(event: string, listener: Listener): void {
    this.on(event, listener);
  }
}

export class FakeStage extends FakeContainer {
  scaleX = 1;
  scaleY = 1;

  globalToRos(x: number, y: number): { x: number; y: number; z: number } {
    return { x: x / this.scaleX, y: -y / this.scaleY, z: 0 };
  }

  rosQuaternionToGlobalTheta({ z, w }: { z: number; w: number }): number {
    return (-2 * Math.atan2(z, w) * 180) / Math.PI;
  }
}

class FakeShape extends Emitter {
  kind = "arrow";
  visible = true;
  rotation = 0;
  scaleX = 1;
  readonly graphics: object = new Proxy({}, { get: () => () => this.graphics });

  addEventListener(event: string, listener: Listener): void {
    this.on(event, listener);
  }
}

export interface FakeMarker {
  kind: string;
  options: { size: number; image?: string };
  x: number;
  y: number;
  rotation: number;
  scaleX: number;
  visible: boolean;
  emit(event: "tick"): void;
}

/** Installs ROS2D and createjs; returns the client of the map once it is made. */
export function installRos2d(): { maps: Emitter[]; options: object[] } {
  const made = { maps: [] as Emitter[], options: [] as object[] };
  const marker = (kind: string) =>
    function make(this: FakeMarker, options: FakeMarker["options"]) {
      Object.assign(this, { kind, options, visible: true, rotation: 0 });
    };
  class Client extends Emitter {
    constructor(options: object) {
      super();
      made.maps.push(this);
      made.options.push(options);
    }
  }
  vi.stubGlobal("createjs", {
    Stage: FakeStage,
    Container: FakeContainer,
    Shape: FakeShape,
    Graphics: { getRGB: (...parts: number[]) => `rgba(${parts})` },
  });
  vi.stubGlobal("ROS2D", {
    NavigationImage: marker("image"),
    OccupancyGridClient: Client,
    ImageMapClient: Client,
  });
  return made;
}
