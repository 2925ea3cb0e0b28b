import { expect, test } from "vitest";
import { type Transform, TransformTree } from "../src/robot/transforms";

const told = (parent: string, child: string, stamp: number, x = 0): Transform => ({
  header: { frame_id: parent, stamp: { sec: Math.floor(stamp), nanosec: (stamp % 1) * 1e9 } },
  child_frame_id: child,
  transform: { translation: { x, y: 0, z: 0 } },
});

/** A tree after messages of one transform each, stamped `period` apart, that come in bursts. */
function treeOf(period: number, burst: number, seconds: number, at = 1000): TransformTree {
  const tree = new TransformTree();
  const messages = Math.round(seconds / period);
  for (let number = 0; number < messages; number++) {
    const arrived = at + period * burst * Math.ceil((number + 1) / burst);
    tree.take([told("odom", "base_link", at + number * period)], false, arrived);
  }
  return tree;
}

test.each([1, 5, 20])("a rate is counted by stamps, also where messages come %i at a time", (burst) => {
  const rate = treeOf(1 / 18.5, burst, 20).frames.get("base_link")?.rate.hz;
  expect(rate).toBeCloseTo(18.5, 1);
});

test.each([0.1, 1, 200, 1000])("a rate of %f Hz is found, and follows a change", (hz) => {
  const tree = treeOf(1 / hz, 1, 3 / hz + 6);
  const { rate } = tree.frames.get("base_link") as { rate: { hz: number; last: number } };
  expect(rate.hz).toBeCloseTo(hz, 1);
  for (let number = 1; number <= 150; number++) {
    const stamp = rate.last + 1 / 40;
    tree.take([told("odom", "base_link", stamp)], false, stamp);
  }
  expect(rate.hz).toBeCloseTo(40, 0);
});

test("a transform that is told twice counts once", () => {
  const tree = new TransformTree();
  for (let number = 0; number < 40; number++) {
    for (let time = 0; time < 3; time++) {
      tree.take([told("odom", "base_link", 1000 + number / 10)], false, 1000 + number / 10 + time / 100);
    }
  }
  expect(tree.frames.get("base_link")?.rate.hz).toBeCloseTo(10, 1);
  expect(tree.faults).toEqual([]);
});

test("loops are found once each, whatever hangs on them", () => {
  const tree = new TransformTree();
  tree.take(
    [
      told("c", "a", 1000),
      told("a", "b", 1000),
      told("b", "c", 1000),
      told("a", "leaf", 1000),
      told("x", "x", 1000),
    ],
    false,
    1000,
  );
  tree.take([told("map", "odom", 1000)], false, 1000);
  expect(tree.loops).toEqual([["a", "b", "c"], ["x"]]);
  expect(tree.roots).toEqual(["map"]);
  expect(tree.faults.map(({ kind }) => kind)).toEqual(["loop", "loop"]);
});

test("two parents are a fault while both are told", () => {
  const tree = new TransformTree();
  const both = (from: number, seconds: number, parents: string[]) => {
    for (let stamp = from; stamp < from + seconds; stamp += 0.1) {
      for (const parent of parents) tree.take([told(parent, "base", stamp)], false, stamp);
    }
  };
  both(1000, 3, ["map", "odom"]);
  expect(tree.faults).toEqual([{ kind: "parents", frames: ["base"], parents: ["map", "odom"] }]);
  both(1003, 11, ["odom"]);
  expect(tree.faults).toEqual([]);
});

test("trees that nothing connects are named by their roots", () => {
  const tree = new TransformTree();
  tree.take([told("map", "odom", 0), told("world", "camera", 0)], true, 1000);
  expect(tree.faults).toEqual([{ kind: "islands", frames: ["map", "world"] }]);
});

test.each([
  ["old", -3],
  ["future", 4],
])("stamps that are %s are a fault; those of localization, half a second ahead, are not", (kind, ahead) => {
  const tree = new TransformTree();
  tree.take([told("map", "odom", 1000 + Number(ahead)), told("odom", "base", 1000.5)], false, 1000);
  expect(tree.faults).toEqual([{ kind, frames: ["odom"], number: Math.abs(Number(ahead)) }]);
});

test("a clock that goes back and a place that jumps are faults, counted", () => {
  const tree = new TransformTree();
  for (let number = 0; number < 50; number++) {
    tree.take([told("map", "odom", 1000 + number / 10, number * 0.01)], false, 1000 + number / 10);
  }
  tree.take([told("map", "odom", 1005, 9)], false, 1005);
  tree.take([told("map", "odom", 1001, 9)], false, 1005.1);
  expect(tree.faults).toEqual([
    { kind: "back", frames: ["odom"], number: 1 },
    { kind: "jump", frames: ["odom"], number: 1 },
  ]);
});

test("no more frames are kept than can be shown", () => {
  const tree = new TransformTree();
  tree.take(
    Array.from({ length: 3000 }, (_, at) => told("map", `frame_${at}`, 1000)),
    false,
    1000,
  );
  expect(tree.frames.size).toBe(2000);
  expect(tree.faults).toEqual([{ kind: "full", frames: [], number: 2000 }]);
});
