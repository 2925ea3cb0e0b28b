import { signal } from "@preact/signals-core";
import { Group } from "three";
import { expect, test } from "vitest";
import type { RobotSession } from "../src/robot/session";
import { Frames } from "../src/scene/frames";

function framesIn(root: Group): Frames {
  const session = { graph: signal({ topics: new Map() }), subscribe: () => () => {} };
  return new Frames(session as unknown as RobotSession, root);
}

test("a place goes when nothing hangs in it any more, and comes back for what does", () => {
  const root = new Group();
  const frames = framesIn(root);
  const arrow = new Group();
  // As a goal whose frame is typed, letter by letter.
  for (const typed of ["m", "ma", "map"]) {
    frames.place(typed).add(arrow);
    frames.update();
  }
  expect(root.children.map(({ name }) => name)).toEqual(["frame map"]);
  arrow.removeFromParent();
  frames.update();
  expect(root.children).toEqual([]);
  frames.place("/map").add(arrow);
  frames.update();
  expect(arrow.parent?.name).toBe("frame map");
  expect(root.children).toEqual([arrow.parent]);
});
