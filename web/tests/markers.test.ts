import { signal } from "@preact/signals-core";
import { Group } from "three";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { LayerContext } from "../src/scene/layers/layer";
import { MarkersLayer } from "../src/scene/layers/markers";

const zero = { x: 0, y: 0, z: 0 };
const marker = (id: number, more: object = {}) => ({
  ...{ header: { frame_id: "map" }, ns: "", id, type: 1, action: 0 },
  ...{
    pose: { position: zero, orientation: { ...zero, w: 1 } },
    scale: zero,
    color: { r: 1, g: 0, b: 0, a: 1 },
  },
  ...more,
});

let hear: (message: object) => void;
let layer: MarkersLayer;

beforeEach(() => {
  vi.useFakeTimers();
  // Each look at the clock is a millisecond later than the last one.
  let now = 0;
  vi.spyOn(performance, "now").mockImplementation(() => ++now);
  const place = new Group();
  layer = new MarkersLayer({
    session: {
      graph: signal({ topics: new Map() }),
      subscribe: (_: string, __: string, listener: (message: object) => void) => {
        hear = listener;
        return () => undefined;
      },
    },
    view: { redraw: () => undefined },
    frames: { place: () => place },
    topic: "/markers",
    type: "visualization_msgs/MarkerArray",
    settings: {},
  } as unknown as LayerContext);
});

afterEach(() => {
  layer.dispose();
  vi.useRealTimers();
  vi.restoreAllMocks();
});

const many = (count: number, more: object = {}) =>
  hear({ markers: Array.from({ length: count }, (_, id) => marker(id, more)) });

test("many markers are built a few at a time", async () => {
  many(100);
  expect(layer.objects.length).toBeLessThan(20);
  await vi.runAllTimersAsync();
  expect(layer.objects.length).toBe(100);
});

test("few markers are there at once", () => {
  many(3);
  expect(layer.objects.length).toBe(3);
});

test("of a marker that is told again before it is built, the last one counts", async () => {
  many(100);
  many(100, { action: 2 });
  await vi.runAllTimersAsync();
  expect(layer.objects.length).toBe(0);
});

test("the deletion of all markers holds for those that are not built yet", async () => {
  many(100);
  hear({ markers: [marker(0, { action: 3 }), marker(7)] });
  await vi.runAllTimersAsync();
  expect(layer.objects.length).toBe(1);
});

test("a marker that cannot be drawn is said, and keeps no other one away", async () => {
  const bad = marker(0, { pose: { position: { x: Number.NaN, y: 0, z: 0 }, orientation: zero } });
  hear({ markers: [bad, marker(1), marker(2)] });
  expect(layer.problem.value).toContain("NaN");
  expect(layer.objects.length).toBe(2);
});

test("more markers than are kept are said before they are built", () => {
  many(10_001);
  expect(layer.problem.value).toBe("more than 10000 markers");
  expect(layer.objects.length).toBeLessThan(20);
});

test("nothing is built after the end", async () => {
  many(100);
  layer.dispose();
  await vi.runAllTimersAsync();
  expect(layer.objects.length).toBe(0);
});
