/** Saving and opening layouts: in the browser, as files, and from the robot's folder. */

import { useSignal } from "@preact/signals";
import { Undo2 } from "lucide";
import { useEffect } from "preact/hooks";
import { Icon } from "../forms/icon";
import { TextField } from "../forms/inputs";
import { Problem } from "../forms/problem";
import { t } from "../i18n/text";
import { saveAs } from "../panels/component";
import { type App, readLayout } from "./state";

const LARGEST_FILE = 1024 * 1024;

export function LayoutMenu({ app, close }: { app: App; close: () => void }) {
  const name = useSignal("");
  const problem = useSignal("");
  const mine = useSignal(app.savedNames);
  const offered = useSignal<string[]>([]);
  useEffect(() => {
    app.offeredLayouts().then(
      (names) => {
        offered.value = names;
      },
      (error: Error) => {
        problem.value = t("app.unreachable", { reason: error.message });
      },
    );
  }, []);
  const attempt = async (act: () => unknown) => {
    try {
      await act();
      close();
    } catch (error) {
      problem.value = t("layout.bad", { reason: (error as Error).message });
    }
  };
  const openFile = (file: File | undefined) =>
    attempt(async () => {
      if (!file) return;
      if (file.size > LARGEST_FILE) throw new Error(`${file.size} bytes`);
      app.show(readLayout(JSON.parse(await file.text())));
    });
  return (
    <div class="layouts">
      <form
        onSubmit={(event) => {
          event.preventDefault();
          if (!name.value.trim()) return;
          app.save(name.value.trim());
          close();
        }}
      >
        <TextField label={t("layout.name")} text={name} />
        <button type="submit">{t("layout.save")}</button>
      </form>
      {problem.value && <Problem text={problem.value} />}
      {mine.value.length > 0 && <h2>{t("layout.mine")}</h2>}
      <ul>
        {mine.value.map((each) => (
          <li key={each} class="pair">
            <button type="button" onClick={() => attempt(() => app.openNamed(each))}>
              {each}
            </button>
            <button
              type="button"
              aria-label={t("layout.delete", { name: each })}
              onClick={() => {
                app.forget(each);
                mine.value = app.savedNames;
              }}
            >
              ×
            </button>
          </li>
        ))}
      </ul>
      {offered.value.length > 0 && <h2>{t("layout.offered")}</h2>}
      <ul>
        {offered.value.map((each) => (
          <li key={each}>
            <a href={linkTo(each)}>{each}</a>
          </li>
        ))}
      </ul>
      <ul>
        {app.canUndo.value && (
          <li>
            <button type="button" onClick={() => attempt(() => app.undo())}>
              <Icon of={Undo2} size={16} /> {t("layout.undo")}
            </button>
          </li>
        )}
        <li>
          <label class="file">
            {t("layout.load")}
            <input
              type="file"
              accept="application/json,.json"
              onChange={(event) => openFile(event.currentTarget.files?.[0])}
            />
          </label>
        </li>
        <li>
          <button type="button" onClick={() => download(app)}>
            {t("layout.download")}
          </button>
        </li>
        <li>
          <button type="button" onClick={() => attempt(() => app.show(app.suggested()))}>
            {t("layout.reset")}
          </button>
        </li>
      </ul>
    </div>
  );
}

function linkTo(name: string): string {
  const target = new URL(location.href);
  target.searchParams.set("layout", name);
  return target.href;
}

function download(app: App): void {
  saveAs(new Blob([JSON.stringify(app.layout, null, 2)], { type: "application/json" }), "layout.json");
}
