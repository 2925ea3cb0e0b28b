/** Forms to choose a robot, and to show it a token. */

import { useSignal } from "@preact/signals";
import { t } from "../i18n/text";
import { type App, isRobotUrl } from "./state";

export function ConnectForm({ app }: { app: App }) {
  const url = useSignal(app.robot);
  const wrong = useSignal(false);
  const go = (event: Event) => {
    event.preventDefault();
    wrong.value = !isRobotUrl(url.value);
    if (wrong.value) return;
    const target = new URL(location.href);
    target.searchParams.set("robot", url.value);
    // The page is loaded anew: its policy names the robots that it may connect to.
    location.assign(target);
  };
  return (
    <form class="card" onSubmit={go}>
      <h2>{t("connect.title")}</h2>
      <p>{t("state.reason", { reason: app.session.reason.value })}</p>
      <label>
        {t("connect.url")}
        <input
          type="text"
          name="robot"
          inputMode="url"
          value={url.value}
          aria-invalid={wrong.value}
          onInput={(event) => {
            url.value = event.currentTarget.value.trim();
          }}
        />
      </label>
      {wrong.value && (
        <p class="problem" role="alert">
          {t("connect.bad")}
        </p>
      )}
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
      <label>
        {t("token.label")}
        <input
          type="password"
          name="token"
          autoComplete="off"
          value={token.value}
          onInput={(event) => {
            token.value = event.currentTarget.value;
          }}
        />
      </label>
      <p class="faint">{t("token.kept")}</p>
      <button type="submit">{t("token.go")}</button>
    </form>
  );
}
