// @vitest-environment happy-dom
import { expect, test, vi } from "vitest";
import { App, MOST_PANELS, readLayout, robotUrl } from "../src/app/state";
import "../src/panels/all";
import { de } from "../src/i18n/de";
import { en } from "../src/i18n/en";
import { chooseLanguage, speak, t, translate } from "../src/i18n/text";
import { panelKinds } from "../src/panels/registry";
import type { WorkerPort } from "../src/robot/transport";

const panel = { id: "one", kind: "topics", config: {} };

test("a layout keeps panels that this page does not know, with their place and settings", () => {
  const dock = { grid: 1 };
  const unknown = { id: "two", kind: "of the future", config: { a: 1 } };
  const layout = { version: 1, panels: [panel, unknown], dock };
  expect(readLayout(layout)).toEqual(layout);
});

test.each([
  null,
  {},
  { version: 2, panels: [] },
  { version: 1, panels: [{}] },
  { version: 1, panels: [{ ...panel, config: null }] },
  { version: 1, panels: [panel, panel] },
])("what is no layout is refused: %j", (value) => expect(() => readLayout(value)).toThrow());

test("a layout of more panels than a browser can show is refused, with the limit", () => {
  const panels = (count: number) =>
    Array.from({ length: count }, (_, number) => ({ ...panel, id: `panel ${number}` }));
  expect(readLayout({ version: 1, panels: panels(MOST_PANELS) }).panels).toHaveLength(MOST_PANELS);
  expect(() => readLayout({ version: 1, panels: panels(3000) })).toThrow(
    "3000 panels; a layout has at most 64",
  );
});

test("a layout that the page did not survive is not opened again", async () => {
  const settings = { robot: null, robots: null };
  const worker = () =>
    ({ postMessage: () => undefined, terminate: () => undefined }) as unknown as WorkerPort;
  const last = JSON.stringify({ version: 1, panels: [panel], dock: null });
  localStorage.setItem("rwt-last-layoutws://robot", last);
  const first = new App(settings, "ws://robot", worker, () => undefined);
  await first.begin(null);
  expect(first.panels.value).toEqual([panel]);
  // Another tab, opened meanwhile, has the layout, too.
  const other = new App(settings, "ws://robot", worker, () => undefined);
  await other.begin(null);
  expect(other.panels.value).toEqual([panel]);
  // The page hangs: nothing of it runs any more. It is loaded again after a while.
  vi.spyOn(Date, "now").mockReturnValue(Date.now() + 60_000);
  const second = new App(settings, "ws://robot", worker, () => undefined);
  await second.begin("some layout of the address");
  expect(second.panels.value).toEqual([]);
  expect(second.session.notices.value.map(({ text }) => text)).toEqual([t("layout.hung")]);
  expect(localStorage.getItem("rwt-last-layoutws://robot")).toBeNull();
  vi.restoreAllMocks();
  localStorage.clear();
});

test.each([
  ["http://robot:9090/", null, "ws://robot:9090/"],
  ["https://hub/robots/anna/", null, "wss://hub/robots/anna/"],
  ["http://laptop/?robot=ws://robot:9090", "ws://other", "ws://robot:9090"],
  ["http://laptop/?robot=javascript:alert(1)", null, "ws://laptop/"],
  ["http://laptop/", "ws://other:9090", "ws://other:9090"],
])("the robot of %s", (href, robot, url) => {
  const place = new URL(href) as unknown as Location;
  expect(robotUrl(place, { robot, robots: null })).toBe(url);
});

test("a translation may leave texts out, and places are filled in", () => {
  translate({ "stop.stop": "Halt" });
  expect([t("stop.stop"), t("stop.release")]).toEqual(["Halt", "Release: hold 1 s"]);
  expect(t("goal.ahead", { step: 0.5 })).toBe("0.5 m ahead");
  translate({});
  expect(t("stop.stop")).toBe("Stop");
});

test("every kind of panel has a title of its own", () => {
  const titles = panelKinds().map(({ title }) => en[title]);
  expect(new Set(titles).size).toBe(titles.length);
});

test("the tables of both languages have the same keys and places, and none is empty", () => {
  expect(Object.keys(de)).toEqual(Object.keys(en));
  const places = (text: string) => (text.match(/\{\w+\}/g) ?? []).sort();
  for (const [key, text] of Object.entries(de)) {
    expect([key, text.trim() !== "", places(text)]).toEqual([key, true, places(en[key as keyof typeof en])]);
  }
});

test.each([
  [["de-AT", "en"], "de"],
  [["fr", "de", "en"], "de"],
  [["en-GB", "de"], "en"],
  [["constructor"], "en"],
  [[], "en"],
])("who prefers %j is spoken to in %s", async (languages, language) => {
  expect(chooseLanguage(languages)).toBe(language);
  await speak(language);
  expect(t("stop.stop")).toBe(language === "de" ? "Stopp" : "Stop");
  await speak("en");
});
