/** Layer of the scene: one topic, drawn. */

import { type Signal, signal } from "@preact/signals-core";
import { Group, type Intersection, type Object3D } from "three";
import type { Palette } from "../../decode/palette";
import type { TextKey } from "../../i18n/text";
import type { RobotSession } from "../../robot/session";
import type { Message, SubscribeOptions } from "../../robot/subscriptions";
import type { Frames } from "../frames";
import type { Detail } from "../governor";
import { disposeTree, type View } from "../view";
import type { Handle } from "./handles";

/** Settings of a layer by choice, as plain JSON. */
export type LayerSettings = Readonly<Record<string, string | number | boolean>>;

/** One thing that can be set of a layer. */
export type LayerOption = { name: OptionName; label?: string } & (
  | { kind: "choice"; values: readonly string[]; usual: string }
  | { kind: "number"; least: number; most: number; step: number; unit: string; usual: number }
  | { kind: "switch"; usual: boolean }
);
export type OptionName =
  | ("colour" | "palette" | "size" | "decay" | "opacity" | "history" | "trail" | "shape")
  | ("visual" | "collision" | "axes" | "names" | "ages" | `namespace ${string}`);

/** Colours of a layer from its least to its greatest value. */
export interface Legend {
  palette: Palette;
  by: string;
  range: readonly [least: number, most: number];
}

/** Context of a layer. */
export interface LayerContext {
  session: RobotSession;
  frames: Frames;
  view: View;
  topic: string;
  /** As the robot writes it. */
  type: string;
  settings: LayerSettings;
}

/** One topic in the scene. Its objects hang in a frame; a fault in a message is said and breaks nothing. */
export abstract class Layer {
  readonly problem: Signal<string> = signal("");
  /** Handles, which the keyboard can hold, too. */
  readonly handles: Signal<readonly Handle[]> = signal([]);
  readonly options: Signal<readonly LayerOption[]> = signal([]);
  readonly legend: Signal<Legend | null> = signal(null);
  /** Points of the topic of which one is drawn. */
  readonly oneOf: Signal<number> = signal(1);
  protected readonly group = new Group();
  private readonly ends: (() => void)[] = [];
  private frame = "";
  private settings: LayerSettings;

  constructor(protected readonly context: LayerContext) {
    this.settings = context.settings;
  }

  /** Follow other settings. */
  configure(settings: LayerSettings): void {
    if (settings === this.settings) return;
    this.settings = settings;
    this.configured();
    this.context.view.redraw();
  }

  /** Called after the settings have changed. */
  protected configured(): void {
    // Most layers read them at the next message.
  }

  /** The value of an option: the chosen one, or else the usual one. */
  protected setting(name: OptionName): string | number | boolean {
    const option = this.options.peek().find((each) => each.name === name);
    const chosen = this.settings[name];
    if (!option) return chosen ?? "";
    if (typeof chosen !== typeof option.usual) return option.usual;
    if (option.kind === "number") return Math.min(option.most, Math.max(option.least, Number(chosen)));
    return chosen ?? option.usual;
  }

  /** Say of what kind a drawn object is, as rows of a name and a value. */
  describe(_hit: Intersection): readonly (readonly [name: TextKey, value: string])[] {
    return [];
  }

  /** Objects of this layer, for the pointer. */
  get objects(): readonly Object3D[] {
    return [this.group];
  }

  /** Frame of the layer's objects. */
  get frameName(): string {
    return this.frame;
  }

  /** Hear the layer's topic, or another one; returns what ends it before the layer does. */
  protected hear(
    listener: (message: Message) => void,
    options: SubscribeOptions = {},
    topic = this.context.topic,
  ): () => void {
    const { session } = this.context;
    const type =
      topic === this.context.topic ? this.context.type : (session.graph.peek().topics.get(topic) ?? "");
    const end = session.subscribe(
      topic,
      type,
      (message) => {
        try {
          listener(message);
          this.problem.value = "";
        } catch (error) {
          this.problem.value = (error as Error).message;
        }
        this.context.view.redraw();
      },
      options,
    );
    this.ends.push(end);
    return end;
  }

  /** Something that ends with the layer. */
  protected until(end: () => void): void {
    this.ends.push(end);
  }

  /** Hang the layer's objects in a frame. */
  protected moveTo(frame: unknown): void {
    const name = String(frame ?? "");
    if (name === this.frame && this.group.parent) return;
    this.frame = name;
    this.context.frames.place(name).add(this.group);
  }

  /** Called before each frame that is drawn. */
  prepare(_detail: Detail): void {
    // Most layers cost the same however finely they are drawn.
  }

  /** Remove what is drawn, and give it back. */
  protected clear(): void {
    for (const child of [...this.group.children]) {
      disposeTree(child);
      this.group.remove(child);
    }
  }

  dispose(): void {
    for (const end of this.ends) end();
    this.clear();
    this.group.removeFromParent();
    this.context.view.redraw();
  }
}

/** Throws unless a number that comes from outside is finite and in a range. */
export function within(name: string, value: unknown, least: number, most: number): number {
  const number = Number(value);
  if (!(number >= least && number <= most))
    throw new Error(`${name} is ${value}; expected ${least} to ${most}`);
  return number;
}

/** The `frame_id` of a message with a header. */
export function frameOf(message: Message): string {
  return String((message.header as { frame_id?: unknown } | undefined)?.frame_id ?? "");
}
