// @vitest-environment happy-dom
import { type LoadingManager, MeshBasicMaterial } from "three";
import URDFLoader from "urdf-loader";
import { afterEach, expect, test, vi } from "vitest";
import type { RobotSession } from "../src/robot/session";
import type { LayerContext } from "../src/scene/layers/layer";
import { isAllowed, loadMesh, meshUrl, readMesh } from "../src/scene/layers/meshes";
import { RobotLayer } from "../src/scene/layers/robot";

const material = new MeshBasicMaterial();

function robot(...origins: string[]): RobotSession {
  const notes: string[] = [];
  return {
    httpBase: "http://robot:9090/anna/",
    httpHeaders: { Authorization: "Bearer secret" },
    meshOrigins: new Set(origins),
    note: (_: string, text: string) => notes.push(text),
    notes,
  } as unknown as RobotSession;
}

/** Answers all requests, and keeps them. */
function answering(body: string): [string, RequestInit | undefined][] {
  const asked: [string, RequestInit | undefined][] = [];
  vi.stubGlobal("fetch", async (url: URL | string | Request, init?: RequestInit) => {
    asked.push([url instanceof Request ? url.url : String(url), init]);
    return new Response(body);
  });
  return asked;
}

afterEach(() => vi.unstubAllGlobals());

test.each([
  ["package://arm/hand.stl", true],
  ["meshes/hand.stl", true],
  ["http://robot:9090/other/hand.stl", true],
  ["https://cdn.example/hand.stl", true],
  ["http://cdn.example/hand.stl", false],
  ["https://robot:9090/hand.stl", false],
  ["//other/hand.stl", false],
  ["file:///etc/hand.stl", false],
  ["data:model/stl,solid", false],
])("the mesh %s may be loaded: %s", (resource, allowed) => {
  const session = robot("https://cdn.example");
  expect(isAllowed(session, meshUrl(session, resource))).toBe(allowed);
});

test("a mesh of another origin is not asked for, and the notice names the setting", async () => {
  const asked = answering("");
  const session = robot();
  loadMesh(session, "http://other/hand.stl", material, () => undefined);
  loadMesh(session, "http://[no-url", material, () => undefined);
  const { notes } = session as unknown as { notes: string[] };
  await vi.waitFor(() => expect(notes).toHaveLength(2));
  expect(notes.join()).toContain("mesh-origins");
  expect(asked).toEqual([]);
});

test("the token goes to the robot's server alone, and no redirection is followed", async () => {
  const asked = answering("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  const session = robot("https://cdn.example");
  await readMesh(meshUrl(session, "package://arm/hand.obj"), session, material);
  await readMesh(meshUrl(session, "https://cdn.example/hand.obj"), session, material);
  expect(asked.map(([, init]) => [init?.headers, init?.redirect])).toEqual([
    [{ Authorization: "Bearer secret" }, "error"],
    [{}, "error"],
  ]);
});

test("what a glTF file names elsewhere is not asked for", async () => {
  const gltf = { asset: { version: "2.0" }, buffers: [{ uri: "https://other/all.bin", byteLength: 4 }] };
  const view = { ...gltf, bufferViews: [{ buffer: 0, byteLength: 4 }], scenes: [{ nodes: [] }], scene: 0 };
  const asked = answering(JSON.stringify({ ...view, accessors: [], meshes: [] }));
  const session = robot();
  await readMesh(meshUrl(session, "package://arm/hand.gltf"), session, material).catch(() => undefined);
  expect(asked.filter(([url]) => url.includes("other"))).toEqual([]);
});

test("what a description names elsewhere is not asked for, its textures included", () => {
  const managers: LoadingManager[] = [];
  // The library itself asks for textures, by its manager; it does not take the XML of happy-dom.
  const parse = vi.spyOn(URDFLoader.prototype, "parse").mockImplementation(function (this: URDFLoader) {
    managers.push(this.manager);
    throw new Error("not drawn");
  });
  const listeners: ((message: object) => void)[] = [];
  const session = {
    ...robot("https://cdn.example"),
    graph: { peek: () => ({ topics: new Map() }) },
    subscribe: (_topic: string, _type: string, listener: (message: object) => void) => {
      listeners.push(listener);
      return () => undefined;
    },
  };
  const view = { redraw: () => undefined };
  const context = { session, view, topic: "/robot_description", type: "std_msgs/String", settings: {} };
  new RobotLayer(context as unknown as LayerContext);
  listeners[0]?.({ data: '<robot name="r"><link name="l"/></robot>' });
  parse.mockRestore();
  const files = [
    "own.png",
    "https://cdn.example/a.png",
    "https://other/a.png",
    "//other/a.png",
    "javascript:0",
  ];
  expect(files.map((file) => managers[0]?.resolveURL(file))).toEqual([
    "http://robot:9090/anna/own.png",
    "https://cdn.example/a.png",
    "data:,",
    "data:,",
    "data:,",
  ]);
});
