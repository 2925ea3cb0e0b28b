/** The kinds of panels, and what a panel is given. */

import type { ReadonlySignal, Signal } from "@preact/signals";
import type { TextKey } from "../i18n/text";
import type { Navigation } from "../robot/navigation";
import type { RobotSession } from "../robot/session";
import type { Stop } from "../robot/stop";

/** Settings of a panel as plain JSON, which is part of saved layouts. */
export type PanelConfig = Record<string, unknown>;

/** Environment of a panel. */
export interface PanelContext {
  session: RobotSession;
  stop: Stop;
  navigation: Navigation;
  /** Where it draws; empty when the panel begins. */
  host: HTMLElement;
  config: Signal<PanelConfig>;
  /** True if it can be seen; what costs something should pause when it cannot. */
  visible: ReadonlySignal<boolean>;
  dark: ReadonlySignal<boolean>;
  /** Open another panel, or show it if it is there. */
  open(kind: string, config?: PanelConfig): void;
  /** Show a recording, an MCAP file, in place of the robot. */
  openRecording(file: File): void;
}

export interface PanelKind {
  name: string;
  title: TextKey;
  /** Types of messages, without `/msg/`, that it shows. */
  supportedTypes: readonly string[];
  /** True if it opens by itself for a robot that supports it. */
  opens(session: RobotSession): boolean;
  /** Where it opens by itself. */
  place: "main" | "right" | "controls" | "below";
  /** True if a recording has nothing for it. */
  needsRobot?: boolean;
  /** Begin; what is returned ends it. */
  init(context: PanelContext): (() => void) | Promise<() => void>;
}

const kinds = new Map<string, PanelKind>();

/** Add a kind of panels; a second one of a name replaces the first. */
export function register(kind: PanelKind): void {
  kinds.set(kind.name, kind);
}

/** Every kind, in the order in which they were added. */
export function panelKinds(): PanelKind[] {
  return [...kinds.values()];
}

/** A kind by its name. */
export function panelKind(name: string): PanelKind | undefined {
  return kinds.get(name);
}

/** Return true if a robot has a topic of one of the types that a kind supports. */
export function hasTopics(kind: Pick<PanelKind, "supportedTypes">, session: RobotSession): boolean {
  return session.topicsOf(...kind.supportedTypes).length > 0;
}
