/** Layer of the scene: one topic, drawn. */

import { type Signal, signal } from "@preact/signals-core";
import { Group } from "three";
import type { RobotSession } from "../../robot/session";
import type { Message, SubscribeOptions } from "../../robot/subscriptions";
import type { Frames } from "../frames";
import type { Detail } from "../governor";
import { disposeTree, type View } from "../view";
import type { Handle } from "./handles";

/** Context of a layer. */
export interface LayerContext {
  session: RobotSession;
  frames: Frames;
  view: View;
  topic: string;
  /** As the robot writes it. */
  type: string;
}

/** One topic in the scene. Its objects hang in a frame; a fault in a message is said and breaks nothing. */
export abstract class Layer {
  readonly problem: Signal<string> = signal("");
  /** Handles, which the keyboard can hold, too. */
  readonly handles: Signal<readonly Handle[]> = signal([]);
  protected readonly group = new Group();
  private readonly ends: (() => void)[] = [];
  private shown = true;
  private frame = "";

  constructor(protected readonly context: LayerContext) {}

  /** Hear the layer's topic, or another one. */
  protected hear(
    listener: (message: Message) => void,
    options: SubscribeOptions = {},
    topic = this.context.topic,
  ): void {
    const { session } = this.context;
    const type =
      topic === this.context.topic ? this.context.type : (session.graph.peek().topics.get(topic) ?? "");
    this.ends.push(
      session.subscribe(
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
      ),
    );
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

  /** Show or hide it. */
  show(shown: boolean): void {
    this.shown = shown;
    this.group.visible = shown;
    this.context.view.redraw();
  }

  get isShown(): boolean {
    return this.shown;
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
