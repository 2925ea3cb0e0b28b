/** Base of all elements: the robot, attributes as properties, error texts, and a style of their own. */

import { effect, type Signal, signal } from "@preact/signals";
import { type ComponentType, render } from "preact";
import { Guard, Problem } from "../../forms/problem";
import { Language, useTexts } from "../../i18n/context";
import "../../i18n/plain";
import type { RobotSession } from "../../robot/session";
import type { Stop } from "../../robot/stop";
import { type Attributes, AttributeValues, attributeName, type PropertiesOf, text } from "./attributes";
import { borrowRobot, homeRobot, type Robot, showToken } from "./connections";
import { languageChanged, useLanguage } from "./language";
import { style as baseStyle } from "./style";

/** Properties of an element's view. */
export interface ViewProps<Element extends RobotElement = RobotElement> {
  element: Element;
  session: RobotSession;
  stop: Stop;
}

/** Return true if a text is the address of a rosbridge server. */
function isRobotUrl(written: string): boolean {
  return /^wss?:\/\/[^\s/]+/i.test(written) && URL.canParse(written);
}

function sheet(style: string): CSSStyleSheet {
  const made = new CSSStyleSheet();
  made.replaceSync(style);
  return made;
}

const sheets = new Map<string, CSSStyleSheet>();

export abstract class RobotElement extends HTMLElement {
  /** The attributes by their properties. */
  static attributes: Attributes = {};
  /** CSS of the element, beside that of all. */
  static style = "";

  static get observedAttributes(): string[] {
    // biome-ignore lint/complexity/noThisInStatic: each element has attributes of its own.
    return [...Object.keys(this.attributes).map(attributeName), "lang"];
  }

  private readonly values: AttributeValues;
  private readonly given: Signal<Robot | null> = signal(null);
  private readonly borrowed: Signal<Robot | null> = signal(null);
  private endBorrowing: (() => void) | undefined;

  constructor() {
    super();
    const { attributes, style } = this.constructor as typeof RobotElement;
    this.values = new AttributeValues(this, attributes);
    const root = this.attachShadow({ mode: "open", delegatesFocus: true });
    root.adoptedStyleSheets = [baseStyle, style].map((css) => {
      const known = sheets.get(css) ?? sheet(css);
      sheets.set(css, known);
      return known;
    });
  }

  /** The view of the element. */
  protected abstract readonly view: ComponentType<ViewProps<never>>;

  /** @internal the value of a property */
  read(property: string): unknown {
    return this.values.of(property).value;
  }

  /** @internal sets a property, and its attribute with it */
  write(property: string, value: unknown): void {
    this.values.set(property, value);
  }

  /**
   * The robot of the element: of its attribute `robot`, of the server that the script came from, or the one that a
   * program has set.
   */
  get robotShown(): Robot | null {
    return this.given.value ?? this.borrowed.value;
  }

  set robotShown(robot: Robot | null) {
    this.given.value = robot;
  }

  attributeChangedCallback(name: string, _: string | null, written: string | null): void {
    if (name === "lang") languageChanged();
    else this.values.changed(name, written);
  }

  connectedCallback(): void {
    const { attributes } = this.constructor as typeof RobotElement;
    // What a framework has set before this script was loaded hides the properties: it is set again.
    const own = this as unknown as Record<string, unknown>;
    for (const property of [...Object.keys(attributes), "robotShown"]) {
      if (!Object.hasOwn(this, property)) continue;
      const value = own[property];
      delete own[property];
      own[property] = value;
    }
    this.endBorrowing = effect(() => {
      const url = String(this.read("robot")) || homeRobot();
      if (this.given.value || !isRobotUrl(url)) {
        this.borrowed.value = null;
        return undefined;
      }
      const { robot, giveBack } = borrowRobot(url);
      this.borrowed.value = robot;
      return giveBack;
    });
    render(
      <Frame element={this} view={this.view as ComponentType<ViewProps>} />,
      this.shadowRoot as ShadowRoot,
    );
  }

  disconnectedCallback(): void {
    render(null, this.shadowRoot as ShadowRoot);
    this.endBorrowing?.();
    this.endBorrowing = undefined;
  }

  /** Tell the page of something. */
  tell(event: string, detail: unknown = null): void {
    this.dispatchEvent(new CustomEvent(`rwt-${event}`, { detail, bubbles: true, composed: true }));
  }
}

/** Attributes that every element has. */
export const COMMON = { robot: text() } as const;

/** Make an element known to the page; a page that has one of that name already keeps it. */
export function defineElement<Kinds extends Attributes>(
  name: string,
  element: (new () => RobotElement) & { attributes: Kinds },
): void {
  for (const property of Object.keys(element.attributes)) {
    Object.defineProperty(element.prototype, property, {
      configurable: true,
      enumerable: true,
      get(this: RobotElement) {
        return this.read(property);
      },
      set(this: RobotElement, value: unknown) {
        this.write(property, value);
      },
    });
  }
  if (!customElements.get(name)) customElements.define(name, element);
}

export type { PropertiesOf };

function Frame(props: { element: RobotElement; view: ComponentType<ViewProps> }) {
  const spoken = useLanguage(props.element);
  if (!spoken) return null;
  return (
    <Language.Provider value={spoken.texts}>
      <Shown {...props} language={spoken.language} />
    </Language.Provider>
  );
}

function Shown(props: { element: RobotElement; view: ComponentType<ViewProps>; language: string }) {
  const { element, view: View, language } = props;
  const t = useTexts();
  const robot = element.robotShown;
  if (!robot) return <Problem text={t("widget.robot", { written: String(element.read("robot")) })} />;
  const { session, stop } = robot;
  const state = session.state.value;
  return (
    <div part="frame" class={`frame state-${state}`} lang={language}>
      {state === "refused" ? <TokenForm session={session} /> : <ConnectionProblem session={session} />}
      <Guard key={session.url}>
        <View element={element} session={session} stop={stop} />
      </Guard>
    </div>
  );
}

function ConnectionProblem({ session }: { session: RobotSession }) {
  const t = useTexts();
  const state = session.state.value;
  if (state === "open") return null;
  const first = session.connections.value === 0;
  if (state === "connecting") return first ? <p part="status">{t("state.connecting")}…</p> : null;
  return (
    <p part="problem" class="problem" role="status">
      {first ? t("widget.unreachable", { url: session.url }) : t("state.lost")}
    </p>
  );
}

function TokenForm({ session }: { session: RobotSession }) {
  const t = useTexts();
  return (
    <form
      part="token"
      onSubmit={(event) => {
        event.preventDefault();
        const field = event.currentTarget.elements.namedItem("token") as HTMLInputElement;
        showToken(session, field.value.trim());
      }}
    >
      <p class="problem" role="status">
        {t("token.title")}
      </p>
      <p class="faint">{t("state.reason", { reason: session.reason.value })}</p>
      <label>
        {t("token.label")} <input type="password" name="token" autoComplete="off" />
      </label>{" "}
      <button type="submit">{t("token.go")}</button>
      <p class="faint">{t("token.kept")}</p>
    </form>
  );
}
