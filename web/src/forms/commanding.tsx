/** Controls that command the robot: greyed out, with the reason, while commands are blocked. */

import type { ComponentChildren } from "preact";
import { useTexts } from "../i18n/context";
import type { Texts } from "../i18n/text";
import type { RobotSession } from "../robot/session";

/** Why commands are blocked; empty while they are sent. */
export function blockText({ commands }: RobotSession, t: Texts): string {
  const why = commands.block.value;
  return why ? t(`blocked.${why}`) : "";
}

/** Group of controls that are disabled while commands are blocked. */
export function Commanding(props: { session: RobotSession; quiet?: boolean; children: ComponentChildren }) {
  const t = useTexts();
  const why = blockText(props.session, t);
  return (
    <>
      <fieldset class="commanding" disabled={why !== ""} title={why}>
        {props.children}
      </fieldset>
      {why && !props.quiet && (
        <p class="blocked" role="status">
          {why}
        </p>
      )}
    </>
  );
}
