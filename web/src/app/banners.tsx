/** Banners above the panels: the stop, the connection, and pending approvals. */

import { stopText } from "../forms/gate";
import { ReleaseButton } from "../forms/release";
import { clockText, fixed } from "../i18n/formats";
import { t } from "../i18n/text";
import { now } from "../panels/component";
import type { App } from "./state";

/** Milliseconds of silence after which the banner appears: shorter ones would move what is below it to and fro. */
const SILENT_FOR = 2000;

export function Banners({ app }: { app: App }) {
  return (
    <>
      <Stopped app={app} />
      <Link app={app} />
      <Senders app={app} />
      <Waiting app={app} />
      <TooLarge app={app} />
    </>
  );
}

function Stopped({ app }: { app: App }) {
  const { stop, session } = app;
  if (!stop.stopped.value) return null;
  const isSent = session.state.value === "open";
  return (
    <div class="stopped">
      <p role="status">{isSent ? stopText(stop, t) : t("stop.pending")}</p>
      <ReleaseButton onRelease={() => stop.release()} />
    </div>
  );
}

/** Why nothing arrives, how old the values are, and when the page tries again. */
function Link({ app }: { app: App }) {
  const { session } = app;
  const { state, silence, reason, retryAt, answeredAt, connections } = session;
  if (connections.value === 0 || state.value === "refused") return null;
  const isOpen = state.value === "open";
  if (isOpen && silence.value < SILENT_FOR) return null;
  const age = Math.max(0, Math.round((now.value - answeredAt.value) / 1000));
  const wait = Math.max(0, Math.ceil((retryAt.value - now.value) / 1000));
  return (
    <div class="link-lost">
      <p>
        <span role="alert">
          {isOpen ? t("state.silent") : t("link.lost", { reason: reason.value })}. {t("link.blocked")}
        </span>{" "}
        {/* A screen reader would say every second. */}
        <span aria-hidden="true">
          {t("link.age", { seconds: age })}{" "}
          {!isOpen && (retryAt.value ? t("link.retry", { seconds: wait }) : t("link.trying"))}
        </span>
      </p>
      {!isOpen && (
        <button type="button" data-scan="press" disabled={!retryAt.value} onClick={() => session.retryNow()}>
          {t("link.now")}
        </button>
      )}
    </div>
  );
}

/** Topics whose messages would stop the page. */
function TooLarge({ app }: { app: App }) {
  const { session } = app;
  const megabytes = (bytes: number) => fixed(bytes / 1e6, bytes < 1e7 ? 1 : 0);
  return (
    <>
      {[...session.refused.value].map(([name, bytes]) => (
        <p key={name} class="too-large" role="status">
          {t("large.refused", { name, size: megabytes(bytes), most: megabytes(session.messageBytes) })}{" "}
          <button type="button" data-scan="press" onClick={() => session.accept(name)}>
            {t("large.accept")}
          </button>
        </p>
      ))}
    </>
  );
}

/** That clients wait for a person's yes, wherever the panel with it is. */
function Waiting({ app }: { app: App }) {
  const count = app.stop.gate.approvals.value.length;
  if (count === 0) return null;
  return (
    <p class="approvals-waiting" role="status">
      <button type="button" data-scan="press" onClick={() => app.open("approvals")}>
        {count === 1 ? t("approvals.waiting.one") : t("approvals.waiting", { count })}
      </button>
    </p>
  );
}

/** A light for each camera and microphone that the robot receives: who is seen or heard has to know. */
function Senders({ app }: { app: App }) {
  const senders = app.senders.value;
  if (senders.length === 0) return null;
  return (
    <div class="senders" role="status">
      {senders.map(({ topic, kind, client, role, since }) => (
        <p key={client + kind}>
          <span class="dot" aria-hidden="true" />
          {t(kind === "audio" ? "senders.audio" : "senders.video", {
            client,
            role,
            topic,
            since: clockText(since * 1000),
          })}
        </p>
      ))}
    </div>
  );
}
