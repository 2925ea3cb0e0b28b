// @vitest-environment happy-dom

import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { MultiStreamViewer, RETRY_AFTER, Viewer } from "../../src/dropin/mjpegcanvas";

const drawn: unknown[][] = [];

beforeEach(() => {
  vi.useFakeTimers();
  drawn.length = 0;
  document.body.innerHTML = '<div id="mjpeg"></div>';
  const context = new Proxy(
    {},
    { get: (_, name) => (name === "drawImage" ? (...what: unknown[]) => drawn.push(what) : () => undefined) },
  );
  vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockReturnValue(context as never);
});

afterEach(() => {
  vi.useRealTimers();
  vi.restoreAllMocks();
});

const common = { divID: "mjpeg", host: "robot", width: 640, height: 480 };

function give(viewer: Viewer): HTMLImageElement {
  Object.defineProperties(viewer.image, { width: { value: 64 }, height: { value: 48 } });
  return viewer.image;
}

describe("Viewer", () => {
  test("asks the server for the topic in the size of the canvas", () => {
    const viewer = new Viewer({ ...common, topic: "/camera/image_raw" });
    expect(viewer.image.src).toBe("http://robot:8080/stream?topic=/camera/image_raw&width=640&height=480");
    expect(document.querySelector("#mjpeg > canvas")).toBe(viewer.canvas);
    expect([viewer.canvas.width, viewer.canvas.height]).toEqual([640, 480]);
  });

  test("passes on port, quality, invert and ssl", () => {
    const options = { port: 9090, quality: 60, invert: true, ssl: true };
    const viewer = new Viewer({ ...common, topic: "a", ...options });
    expect(viewer.image.src).toBe(
      "https://robot:9090/stream?topic=a&width=640&height=480&quality=60&invert=true",
    );
  });

  test("a topic that is no name adds no parameters", () => {
    const viewer = new Viewer({ ...common, topic: "/a&type=h264#<img onerror=alert(1)>" });
    expect(viewer.image.src).toContain("topic=/a%26type%3Dh264%23%3Cimg%20onerror%3Dalert(1)%3E&width");
  });

  test("draws the picture and then the overlay, as often as it is told to", () => {
    const overlay = document.createElement("canvas");
    const viewer = new Viewer({ ...common, topic: "/a", overlay, interval: 200 });
    const image = give(viewer);
    vi.advanceTimersByTime(199);
    expect(drawn).toEqual([]);
    vi.advanceTimersByTime(1);
    expect(drawn).toEqual([
      [image, 0, 0, 640, 480],
      [overlay, 0, 0],
    ]);
  });

  test("warns while there is no picture, and asks again after an error", () => {
    const viewer = new Viewer({ ...common, topic: "/a" });
    const warned = vi.fn();
    viewer.on("warning", warned);
    vi.advanceTimersByTime(200);
    expect(warned.mock.calls).toEqual([["Invalid stream."], ["Invalid stream."]]);
    const asked = vi.spyOn(viewer.image, "src", "set");
    viewer.image.dispatchEvent(new Event("error"));
    vi.advanceTimersByTime(RETRY_AFTER);
    expect(asked).toHaveBeenCalledWith(expect.stringContaining("topic=/a&"));
  });

  test("another stream takes the place of the first, whose connection ends", () => {
    const viewer = new Viewer({ ...common, topic: "/a" });
    const changed = vi.fn();
    viewer.on("change", changed);
    const before = viewer.image;
    viewer.changeStream("/b");
    expect(changed).toHaveBeenCalledWith("/b");
    expect(before.getAttribute("src")).toBe("");
    expect(viewer.image.src).toContain("topic=/b&");
  });

  test("says which element is missing", () => {
    expect(() => new Viewer({ ...common, divID: "gone", topic: "/a" })).toThrow(
      "no element with the id gone",
    );
  });
});

describe("MultiStreamViewer", () => {
  const topics = ["/front", "/left"];

  test("offers the streams by their labels and changes to the chosen one", () => {
    const viewer = new MultiStreamViewer({
      ...common,
      topics,
      labels: ["Front", "<b>Left</b>"],
      defaultStream: 1,
    });
    const changed = vi.fn();
    viewer.on("change", changed);
    const list = document.querySelector("select") as HTMLSelectElement;
    expect([...list.options].map((each) => each.textContent)).toEqual(["Front", "<b>Left</b>"]);
    expect(list.value).toBe("/left");
    const [edit, close] = document.querySelectorAll("button");
    const menu = list.closest("div") as HTMLElement;
    edit?.click();
    expect([menu.hidden, document.activeElement]).toEqual([false, list]);
    list.value = "/front";
    list.dispatchEvent(new Event("change"));
    close?.click();
    expect([menu.hidden, document.activeElement]).toEqual([true, edit]);
    expect(changed).toHaveBeenCalledWith("/front");
  });

  test("passes on warnings", () => {
    const viewer = new MultiStreamViewer({ ...common, topics });
    const warned = vi.fn();
    viewer.on("warning", warned);
    vi.advanceTimersByTime(100);
    expect(warned).toHaveBeenCalledWith("Invalid stream.");
  });

  test("refuses a default stream that is not there", () => {
    expect(() => new MultiStreamViewer({ ...common, topics, defaultStream: 2 })).toThrow(
      "defaultStream is 2, of 2 topics",
    );
  });
});
