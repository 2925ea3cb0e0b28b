/** `<rwt-stop>`: a button that stops the robot, and keeps the controls of the page from moving it. */

import { useLayoutEffect } from "preact/hooks";
import { stopText } from "../../forms/gate";
import { ReleaseButton } from "../../forms/release";
import { useTexts } from "../../i18n/context";
import { flag, text } from "../base/attributes";
import { COMMON, defineElement, RobotElement, type ViewProps } from "../base/element";
import { style } from "./style";

export class StopElement extends RobotElement {
  static override attributes = {
    ...COMMON,
    /** A key that stops from anywhere in the page, as `Escape`. */
    shortcut: text(),
    /** True if the state is not shown beside the button. */
    quiet: flag(),
  };
  static override style = style;
  declare robot: string;
  declare shortcut: string;
  declare quiet: boolean;

  protected override readonly view = StopView;

  /** True if the controls of the page are kept from moving the robot. */
  get stopped(): boolean {
    return this.robotShown?.stop.stopped.value ?? false;
  }

  /** Stop the robot, and tell `rwt-stop`. */
  stop(): void {
    this.robotShown?.stop.stop();
    this.tell("stop");
  }

  /** Let the controls of the page work again, and tell `rwt-release`; nothing moves by that. */
  release(): void {
    this.robotShown?.stop.release();
    this.tell("release");
  }
}

function StopView({ element, session, stop }: ViewProps<StopElement>) {
  const t = useTexts();
  const { shortcut } = element;
  useLayoutEffect(() => {
    if (!shortcut) return undefined;
    const onKey = (event: KeyboardEvent) => {
      if (event.key === shortcut && !event.repeat) element.stop();
    };
    addEventListener("keydown", onKey, { capture: true });
    return () => removeEventListener("keydown", onKey, { capture: true });
  }, [element, shortcut]);
  const stopped = stop.stopped.value;
  const { topics, actions } = stop.reaches;
  const nothing = session.state.value === "open" && topics.length + actions.length === 0;
  return (
    <>
      <div class="row">
        <button
          type="button"
          part="button"
          class={stopped ? "stop latched" : "stop"}
          aria-keyshortcuts={shortcut || undefined}
          onClick={() => element.stop()}
        >
          {t(stopped ? "stop.latched" : "stop.stop")}
        </button>
        {stopped && <ReleaseButton onRelease={() => element.release()} />}
      </div>
      {!element.quiet && (
        <p part="status" role="status">
          {stopped ? stopText(stop, t) : nothing ? t("stop.nothing") : ""}
        </p>
      )}
    </>
  );
}

defineElement("rwt-stop", StopElement);
