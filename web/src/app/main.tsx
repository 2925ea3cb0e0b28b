/** Where the page begins. */

import "./style.css";
import { render } from "preact";
import "../panels/all";
import { chooseLanguage, speak } from "../i18n/text";
import type { WorkerPort } from "../robot/transport";
import { Shell } from "./shell";
import { App, type PageSettings, robotUrl } from "./state";

async function pageSettings(): Promise<PageSettings> {
  const response = await fetch("web/settings.json");
  return response.ok ? response.json() : { robot: null, layouts: [] };
}

const language = chooseLanguage(navigator.languages);
document.documentElement.lang = language;
const [settings] = await Promise.all([pageSettings(), speak(language)]);
const worker = new Worker(new URL(DECODE_WORKER, import.meta.url)) as unknown as WorkerPort;
const app = new App(settings, robotUrl(location, settings), worker);
document.title = `${new URL(app.robot).host} · ${document.title}`;
render(<Shell app={app} />, document.getElementById("app") as HTMLElement);
void app.begin(new URLSearchParams(location.search).get("layout"));
