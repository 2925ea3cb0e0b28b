/** State of the whole page: the robot, the stop, the look, and the open panels. */

import { computed, effect, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import { t } from "../i18n/text";
import { type PanelConfig, panelKinds } from "../panels/registry";
import { describedName } from "../robot/description";
import { Navigation } from "../robot/navigation";
import { mediaSenders, type Sender } from "../robot/senders";
import { RobotSession } from "../robot/session";
import { Stop } from "../robot/stop";
import type { WorkerPort } from "../robot/transport";

/** One open panel. */
export interface OpenPanel {
  id: string;
  kind: string;
  config: PanelConfig;
}

/** Saved layout: in the browser, as a file, or in the robot's folder of layouts. */
export interface Layout {
  version: 1;
  panels: OpenPanel[];
  /** Where the panels are docked, in dockview's own form; null lets the page decide. */
  dock: unknown;
}

/** The settings of the server that the page came from. */
export interface PageSettings {
  robot: string | null;
  /** Where a hub lists its robots, of which this is one; null without a hub. */
  robots: string | null;
  /** Bytes of a message above which its topic is shown on request; null for the page's own limit. */
  message_bytes?: number | null;
}

/** Bytes of a message above which its topic is shown on request, unless the server says how many. */
const MESSAGE_BYTES = 20_000_000;
/** Panels of a layout: more would keep the browser busy for minutes. */
export const MOST_PANELS = 64;

const TOKEN = "rwt-token ";
const LAYOUT = "rwt-layout ";
const LAST = "rwt-last-layout";
/** Milliseconds for which a layout must not have stopped the page before it counts as opened. */
const SETTLED = 1000;
/** Time at which a layout began to open, in ms; removed once it is drawn, or the page is left. */
const OPENING = "rwt-opening-layout ";
/** Milliseconds after which a layout that is still opening has stopped the page. Other tabs open layouts, too. */
const HUNG = 5000;
const THEME = "rwt-theme";
const SIDE = "rwt-side";

/** Arrangements that can be gone back to. */
const MOST_UNDONE = 20;

function kindsIn({ panels }: Layout): string {
  return panels.map(({ id }) => id).join("\n");
}

/** Return true if a text is the address of a rosbridge server. */
export function isRobotUrl(text: string): boolean {
  return /^wss?:\/\/[^\s/]+/i.test(text) && URL.canParse(text);
}

/** Where the robot is that this page belongs to, or the one that its address names. */
export function robotUrl(location: Location, settings: PageSettings): string {
  const named = new URLSearchParams(location.search).get("robot") ?? settings.robot;
  return named && isRobotUrl(named) ? named : ownUrl(location);
}

/** Where the robot is that has this page's server. */
function ownUrl(location: Location): string {
  const base = new URL(".", location.href);
  base.protocol = base.protocol === "https:" ? "wss:" : "ws:";
  base.search = base.hash = "";
  return base.href;
}

/** A layout from JSON. Throws, with a text for people, where it is none. */
export function readLayout(value: unknown): Layout {
  const { version, panels, dock } = (value ?? {}) as Partial<Layout>;
  if (version !== 1 || !Array.isArray(panels)) throw new Error("version 1 and a list of panels are expected");
  if (panels.length > MOST_PANELS) {
    throw new Error(`${panels.length} panels; a layout has at most ${MOST_PANELS}`);
  }
  const seen = new Set<string>();
  for (const panel of panels) {
    const isPanel =
      typeof panel?.id === "string" &&
      typeof panel.kind === "string" &&
      typeof panel.config === "object" &&
      panel.config !== null;
    if (!isPanel) throw new Error("a panel without id, kind and config");
    if (seen.has(panel.id)) throw new Error(`two panels with the id ${panel.id}`);
    seen.add(panel.id);
  }
  // A panel that this page does not know keeps its place and its settings for the page that does.
  return { version: 1, panels, dock: dock ?? null };
}

export class App {
  readonly session: RobotSession;
  readonly stop: Stop;
  readonly navigation: Navigation;
  /** Displayed name of the robot: its name, else its address. */
  readonly name: ReadonlySignal<string>;
  /** Senders whose cameras and microphones are on. */
  readonly senders: ReadonlySignal<readonly Sender[]>;
  readonly panels: Signal<OpenPanel[]> = signal([]);
  /** The panel that is shown where only one can be. */
  readonly front: Signal<string> = signal("");
  /** The panel that somebody asked for last: it is shown, and gets the keyboard. */
  readonly asked: Signal<{ id: string } | null> = signal(null);
  readonly dock: Signal<unknown> = signal(null);
  /** Counts up when another layout takes the place of the one that is shown. */
  readonly replaced = signal(0);
  readonly theme: Signal<"auto" | "light" | "dark">;
  private readonly systemDark = matchMedia("(prefers-color-scheme: dark)");
  private readonly systemIsDark = signal(this.systemDark.matches);
  readonly dark = computed(() =>
    this.theme.value === "auto" ? this.systemIsDark.value : this.theme.value === "dark",
  );
  /** True if the page is used with one switch. */
  readonly scanning: Signal<boolean> = signal(false);
  /** True if the list of topics is shown. */
  readonly side: Signal<boolean>;
  /** Settings of the panels that are drawn now, by their ids. */
  readonly configs: Signal<ReadonlyMap<string, Signal<PanelConfig>>> = signal(new Map());
  private opened = false;
  /** Earlier arrangements, the last one at the end; of changes within a second the first one. */
  private readonly earlier: Signal<readonly Layout[]> = signal([]);
  private isUndoing = false;
  readonly canUndo = computed(() => this.earlier.value.length > 0);

  /** Layout that the address names, and that the server did not give without a token. */
  private refusedLayout: string | null = null;

  /**
   * @param settings settings of the server
   * @param robot address of the robot
   * @param workers starts the worker that connects to the robot, or plays a recording
   * @param replace shows another state of the page in place of this one
   * @param recording MCAP file that is played instead of a connection to the robot
   */
  constructor(
    readonly settings: PageSettings,
    readonly robot: string,
    private readonly workers: (recording: File | null) => WorkerPort,
    private readonly replace: (app: App) => void,
    readonly recording: File | null = null,
  ) {
    this.theme = signal((localStorage.getItem(THEME) as "light" | "dark" | null) ?? "auto");
    const side = localStorage.getItem(SIDE);
    this.side = signal(side === null ? matchMedia("(min-width: 1181px)").matches : side === "true");
    this.systemDark.addEventListener("change", ({ matches }) => {
      this.systemIsDark.value = matches;
    });
    this.session = new RobotSession({
      url: robot,
      token: sessionStorage.getItem(TOKEN + robot) ?? "",
      worker: () => workers(recording),
      isRecording: recording !== null,
      messageBytes: recording ? Number.POSITIVE_INFINITY : (settings.message_bytes ?? MESSAGE_BYTES),
    });
    this.stop = new Stop(this.session);
    this.navigation = new Navigation(this.session);
    this.senders = mediaSenders(this.session);
    const described = describedName(this.session);
    const { host, pathname } = new URL(robot);
    this.name = computed(
      () => recording?.name ?? (described.value || (pathname === "/" ? host : host + pathname)),
    );
    effect(() => {
      document.documentElement.dataset.theme = this.dark.value ? "dark" : "light";
    });
  }

  /** Show the layout that the address names, the one that was open last, or panels for what is found. */
  async begin(named: string | null): Promise<void> {
    const began = localStorage.getItem(OPENING + this.robot);
    if (began !== null && Date.now() - Number(began) > HUNG) {
      localStorage.removeItem(OPENING + this.robot);
      localStorage.removeItem(LAST + this.robot);
      this.session.note("error", t("layout.hung"));
    } else if (named) await this.openNamed(named);
    // The panels of a robot, and those of another recording, have other topics.
    const last = this.recording ? null : localStorage.getItem(LAST + this.robot);
    if (!this.opened && last) {
      try {
        this.show(readLayout(JSON.parse(last)));
      } catch {
        localStorage.removeItem(LAST + this.robot); // It was of an older page: start afresh.
      }
    }
    effect(() => {
      if (!this.opened && this.session.graph.value.topics.size) this.show(this.suggested());
    });
    let shown: Layout | null = null;
    let rememberedAt = 0;
    effect(() => {
      const layout = this.layout;
      if (!this.opened) return;
      if (!this.recording) localStorage.setItem(LAST + this.robot, JSON.stringify(layout));
      const before = shown;
      shown = layout;
      // Settings of panels, and sizes, are no arrangement.
      if (!before || kindsIn(before) === kindsIn(layout) || this.isUndoing) return;
      if (Date.now() - rememberedAt > SETTLED) {
        this.earlier.value = [...this.earlier.peek(), before].slice(-MOST_UNDONE);
      }
      rememberedAt = Date.now();
    });
  }

  /** The panels for what the robot offers. */
  suggested(): Layout {
    const panels = panelKinds()
      .filter((kind) => kind.opens(this.session) && !(this.recording && kind.needsRobot))
      .map(({ name }) => ({ id: name, kind: name, config: {} }));
    return { version: 1, panels, dock: null };
  }

  /** False only if this page knows that nothing moves by its commands, and that it could not begin to unseen. */
  mayBeMoving(): boolean {
    const { session, stop, navigation } = this;
    const { client, holders } = stop.gate;
    return (
      !session.isAnswering ||
      session.commands.isActing ||
      navigation.progress.peek()?.outcome === "sent" ||
      [...holders.peek().values()].some(({ name }) => name !== "" && [name, ""].includes(client.peek()))
    );
  }

  get layout(): Layout {
    return { version: 1, panels: this.panels.value, dock: this.dock.value };
  }

  show(layout: Layout): void {
    this.opened = true;
    localStorage.setItem(OPENING + this.robot, String(Date.now()));
    const opened = () => localStorage.removeItem(OPENING + this.robot);
    setTimeout(opened, SETTLED);
    addEventListener("pagehide", opened, { once: true });
    this.panels.value = layout.panels;
    this.dock.value = layout.dock;
    this.front.value = layout.panels[0]?.id ?? "";
    this.replaced.value++;
  }

  /** Open a layout of this browser, or else of the robot's folder. */
  async openNamed(name: string): Promise<void> {
    try {
      const stored = localStorage.getItem(LAYOUT + name);
      this.show(readLayout(stored === null ? await this.fetchLayout(name) : JSON.parse(stored)));
    } catch (error) {
      // Without a token, the page asks for one, and then opens the layout.
      if (this.refusedLayout === name) return;
      this.session.note("error", t("layout.missing", { name, reason: (error as Error).message }));
    }
  }

  private async fetchLayout(name: string): Promise<unknown> {
    const response = await this.fetchOwn(`web/layouts/${encodeURIComponent(name)}`);
    if (response.status === 401) this.refusedLayout = name;
    if (!response.ok) throw new Error((await response.text()).trim());
    return response.json();
  }

  /** Names of the layouts that the page's server offers to this user. */
  async offeredLayouts(): Promise<string[]> {
    const response = await this.fetchOwn("web/settings.json");
    return response.ok ? (await response.json()).layouts : [];
  }

  /** Ask the server of this page, which may be another one than the robot's, with the token that it knows. */
  private fetchOwn(path: string): Promise<Response> {
    const token = sessionStorage.getItem(TOKEN + ownUrl(location)) ?? "";
    return fetch(path, token ? { headers: { Authorization: `Bearer ${token}` } } : {});
  }

  /** Open a panel, or show the one of the same kind and settings. */
  open(kind: string, config: PanelConfig = {}): void {
    const same = this.panels
      .peek()
      .find((panel) => panel.kind === kind && JSON.stringify(panel.config) === JSON.stringify(config));
    if (same) {
      this.bring(same.id);
      return;
    }
    if (this.panels.peek().length >= MOST_PANELS) {
      this.session.note("warning", t("layout.full", { most: MOST_PANELS }));
      return;
    }
    const taken = new Set(this.panels.peek().map(({ id }) => id));
    let id = kind;
    for (let number = 2; taken.has(id); number++) id = `${kind} ${number}`;
    this.panels.value = [...this.panels.peek(), { id, kind, config }];
    this.bring(id);
  }

  /** Which layers of the first 3D panel are shown by choice; null without such a panel. */
  readonly layers = computed(() => {
    const config = this.configOf("scene");
    return config && ((config.value.layers ?? {}) as Record<string, boolean>);
  });

  private configOf(kind: string): Signal<PanelConfig> | null {
    const panel = this.panels.value.find((each) => each.kind === kind);
    return (panel && this.configs.value.get(panel.id)) ?? null;
  }

  /** Draw a topic in the first 3D panel, or do not. */
  draw(topic: string, shown: boolean): void {
    const config = this.configOf("scene");
    if (config) config.value = { ...config.value, layers: { ...this.layers.value, [topic]: shown } };
  }

  /** Show a topic in the panel of topics. */
  inspect(topic: string): void {
    const config = this.configOf("topics");
    const panel = this.panels.value.find(({ kind }) => kind === "topics");
    if (config && panel) {
      config.value = { ...config.value, topic };
      this.front.value = panel.id;
    } else this.open("topics", { topic });
  }

  private bring(id: string): void {
    this.front.value = id;
    this.asked.value = { id };
  }

  close(id: string): void {
    const rest = this.panels.peek().filter((panel) => panel.id !== id);
    this.panels.value = rest;
    if (this.front.peek() === id) this.front.value = rest[0]?.id ?? "";
  }

  configure(id: string, config: PanelConfig): void {
    this.panels.value = this.panels.peek().map((panel) => (panel.id === id ? { ...panel, config } : panel));
  }

  /** Go back to the panels before the last one was opened, closed or replaced. */
  undo(): void {
    const layout = this.earlier.peek().at(-1);
    if (!layout) return;
    this.isUndoing = true;
    this.show(layout);
    this.isUndoing = false;
    this.earlier.value = this.earlier.peek().slice(0, -1);
  }

  /**
   * Open a recording in place of the robot, to which the page is connected no longer: all that it holds there is released
   * as if it were closed. A file that cannot be read leaves the page as it is.
   */
  openRecording(file: File): void {
    const opened = new App(this.settings, this.robot, this.workers, this.replace, file);
    const { state, reason } = opened.session;
    const end = effect(() => {
      if (state.value === "connecting") return;
      queueMicrotask(() => end());
      const isOpen = state.value === "open";
      (isOpen ? this : opened).session.close();
      if (isOpen) this.replace(opened);
      else this.session.note("error", t("recording.bad", { name: file.name, reason: reason.value }));
    });
  }

  get savedNames(): string[] {
    return Object.keys(localStorage)
      .filter((key) => key.startsWith(LAYOUT))
      .map((key) => key.slice(LAYOUT.length))
      .sort();
  }

  save(name: string): void {
    localStorage.setItem(LAYOUT + name, JSON.stringify(this.layout));
  }

  forget(name: string): void {
    localStorage.removeItem(LAYOUT + name);
  }

  showSide(shown: boolean): void {
    this.side.value = shown;
    localStorage.setItem(SIDE, String(shown));
  }

  setTheme(theme: "light" | "dark"): void {
    this.theme.value = theme;
    localStorage.setItem(THEME, theme);
  }

  authenticate(token: string): void {
    sessionStorage.setItem(TOKEN + this.robot, token);
    this.session.authenticate(token);
    const refused = this.refusedLayout;
    this.refusedLayout = null;
    if (refused !== null) void this.openNamed(refused);
  }
}
