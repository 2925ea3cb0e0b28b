/** Where the page begins. */

import "./tokens.css";
import "./style.css";
import { effect } from "@preact/signals";
import { render } from "preact";
import "../panels/all";
import { plain } from "../i18n/plain";
import { chooseLanguage, speak, t } from "../i18n/text";
import type { WorkerPort } from "../robot/transport";
import { Shell } from "./shell";
import { App, type PageSettings, robotUrl } from "./state";

/** Milliseconds for the settings to come, and between two attempts to have them. */
const PATIENCE = 10_000;
const AGAIN = 2000;

const place = document.getElementById("app") as HTMLElement;

async function pageSettings(): Promise<PageSettings> {
  for (;;) {
    try {
      const response = await fetch("web/settings.json", { signal: AbortSignal.timeout(PATIENCE) });
      const robots = /<([^>]+)>; rel="collection"/.exec(response.headers.get("Link") ?? "")?.[1] ?? null;
      return { ...(response.ok ? await response.json() : { robot: null }), robots };
    } catch (error) {
      place.textContent = t("app.unreachable", { reason: (error as Error).message });
      await new Promise((later) => setTimeout(later, AGAIN));
      place.textContent = "";
    }
  }
}

const language = await speak(chooseLanguage(navigator.languages));
document.documentElement.lang = language;
const settings = await pageSettings();
const { title } = document;
const startWorker = (recording: File | null) => {
  const script = recording ? RECORDING_WORKER : DECODE_WORKER;
  const worker = new Worker(new URL(script, import.meta.url)) as unknown as WorkerPort;
  if (recording) worker.postMessage({ kind: "file", file: recording });
  return worker;
};
let endTitle: (() => void) | undefined;

function show(app: App): void {
  endTitle?.();
  endTitle = effect(() => {
    document.title = plain(`${app.name.value} · ${title}`);
  });
  render(null, place);
  render(<Shell app={app} />, place);
  void app.begin(app.recording ? null : new URLSearchParams(location.search).get("layout"));
}

place.textContent = "";
show(new App(settings, robotUrl(location, settings), startWorker, show));
