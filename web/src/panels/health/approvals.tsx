/** Requests that require approval: client, command and decision. */

import { useSignal } from "@preact/signals";
import { Commanding } from "../../forms/commanding";
import { Problem } from "../../forms/problem";
import { type TextKey, t } from "../../i18n/text";
import type { Approval } from "../../robot/gate";
import { seconds } from "../../robot/names";
import { componentPanel, now } from "../component";
import type { PanelContext, PanelKind } from "../registry";

const APPROVE = "/gate/approve";
const ACTS: ReadonlyMap<string, TextKey> = new Map([
  ["publish", "approvals.publish"],
  ["call", "approvals.call"],
  ["goal", "approvals.goal"],
  ["set_param", "approvals.set_param"],
]);

export const approvals: PanelKind = {
  name: "approvals",
  title: "approvals.title",
  supportedTypes: ["rwt_gate_msgs/Approvals"],
  opens: (session) => session.graph.value.services.includes(APPROVE),
  place: "controls",
  needsRobot: true,
  init: componentPanel(ApprovalsPanel),
};

/** A time in words: whole minutes, or seconds. */
export function timeText(span: number): string {
  return span >= 60 && span % 60 === 0
    ? t("approvals.minutes", { minutes: span / 60 })
    : t("approvals.seconds", { seconds: Math.round(span) });
}

function ApprovalsPanel({ context }: { context: PanelContext }) {
  const { session, stop } = context;
  if (!session.graph.value.services.includes(APPROVE)) {
    return <p class="faint">{t("approvals.absent")}</p>;
  }
  const waiting = stop.gate.approvals.value;
  return (
    <div class="approvals" aria-live="polite">
      {waiting.length === 0 && <p class="faint">{t("approvals.none")}</p>}
      {waiting.map((each) => (
        <OneApproval key={each.id} context={context} approval={each} />
      ))}
    </div>
  );
}

function OneApproval({ context, approval }: { context: PanelContext; approval: Approval }) {
  const { act, client, content, id, name, remember_seconds, role, rule } = approval;
  const problem = useSignal("");
  const busy = useSignal(false);
  const answer = async (approve: boolean, span = 0) => {
    busy.value = true;
    try {
      await context.stop.gate.answer(id, approve, span);
      problem.value = "";
    } catch (error) {
      problem.value = (error as Error).message;
    }
    busy.value = false;
  };
  // By the robot's clock, which may not be the page's: more than there was at first is never shown.
  const left = seconds(approval.asked) + approval.seconds - now.value / 1000;
  return (
    <section class="approval" aria-label={`${client}: ${name}`}>
      <p>
        <strong>{t("approvals.who", { client, role })}</strong> {t(ACTS.get(act) ?? "approvals.call")}{" "}
        <strong>{name}</strong>
      </p>
      {/* It is scrolled, and may be longer than it is shown. */}
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls has to be reached by the keyboard */}
      <pre tabIndex={0}>{readableJson(content)}</pre>
      <p class="faint">
        {t("approvals.rule", { rule })} ·{" "}
        {t("approvals.left", { seconds: Math.round(Math.max(0, Math.min(approval.seconds, left))) })}
      </p>
      <div class="plot-bar">
        <Commanding session={context.session} quiet>
          <button type="button" data-scan="press" disabled={busy.value} onClick={() => answer(true)}>
            {t("approvals.yes")}
          </button>
          {remember_seconds > 0 && (
            <button
              type="button"
              data-scan="press"
              disabled={busy.value}
              onClick={() => answer(true, remember_seconds)}
            >
              {t("approvals.yes_for", { time: timeText(remember_seconds) })}
            </button>
          )}
        </Commanding>
        <button type="button" data-scan="press" disabled={busy.value} onClick={() => answer(false)}>
          {t("approvals.no")}
        </button>
      </div>
      {problem.value && <Problem text={problem.value} />}
    </section>
  );
}

/** The digest of the content, and its JSON with a line for each value; cut content is shown unchanged. */
function readableJson(text: string): string {
  const at = text.indexOf("{");
  try {
    return text.slice(0, at) + JSON.stringify(JSON.parse(text.slice(at)), null, 2);
  } catch {
    return text;
  }
}
