/** Forms to choose a robot, and to show it a token. */

import { useSignal } from "@preact/signals";
import { TextField } from "../forms/inputs";
import { Problem } from "../forms/problem";
import { t } from "../i18n/text";
import { type App, isRobotUrl } from "./state";

export function ConnectForm({ app }: { app: App }) {
  const url = useSignal(app.robot);
  const wrong = useSignal(false);
  const go = (event: Event) => {
    event.preventDefault();
    const wanted = url.value.trim();
    wrong.value = !isRobotUrl(wanted);
    if (wrong.value) return;
    const target = new URL(location.href);
    target.searchParams.set("robot", wanted);
    // The page is loaded anew: its policy names the robots that it may connect to.
    location.assign(target);
  };
  return (
    <form class="card" onSubmit={go}>
      <h2>{t("connect.title")}</h2>
      <p>{t("state.reason", { reason: app.session.reason.value })}</p>
      <TextField
        label={t("connect.url")}
        text={url}
        name="robot"
        inputMode="url"
        aria-invalid={wrong.value}
      />
      {wrong.value && <Problem text={t("connect.bad")} />}
      <button type="submit">{t("connect.go")}</button>
    </form>
  );
}

export function TokenForm({ app }: { app: App }) {
  const token = useSignal("");
  return (
    <form
      class="card"
      onSubmit={(event) => {
        event.preventDefault();
        app.authenticate(token.value.trim());
      }}
    >
      <h2>{t("token.title")}</h2>
      <p>{t("state.reason", { reason: app.session.reason.value })}</p>
      <TextField label={t("token.label")} text={token} type="password" name="token" autoComplete="off" />
      <p class="faint">{t("token.kept")}</p>
      <button type="submit">{t("token.go")}</button>
    </form>
  );
}
