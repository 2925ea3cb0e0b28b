/** Meshes by the names that robots give them: `package://…` and URLs, as STL, Collada, OBJ or glTF. */

import { Group, LoadingManager, type Material, Mesh, type Object3D } from "three";
import type { RobotSession } from "../../robot/session";

/** Where a file of a robot is served. */
export function meshUrl(session: RobotSession, resource: string): URL {
  const found = /^package:\/\/(.*)$/.exec(resource);
  return found ? new URL(`packages/${found[1]}`, session.httpBase) : new URL(resource, session.httpBase);
}

/**
 * Whether a file may be loaded: of the robot's server, and of the origins that the page allows. A robot could otherwise
 * have each of its viewers send requests anywhere, with their addresses.
 */
export function isAllowed(session: RobotSession, url: URL): boolean {
  return url.origin === new URL(session.httpBase).origin || session.meshOrigins.has(url.origin);
}

/** Let a manager load what is within a file, such as textures: what is not allowed is replaced by nothing. */
export function guard(manager: LoadingManager, session: RobotSession, base: URL): LoadingManager {
  manager.setURLModifier((written) => {
    if (!URL.canParse(written, base)) return "data:,";
    const url = new URL(written, base);
    return url.protocol === "data:" || url.protocol === "blob:" || isAllowed(session, url)
      ? url.href
      : "data:,";
  });
  return manager;
}

/** An empty group that the mesh appears in when it has come; `redraw` is called then. */
export function loadMesh(
  session: RobotSession,
  resource: string,
  material: Material,
  redraw: () => void,
): Object3D {
  const group = new Group();
  // Also a name that is no URL is reported.
  const read = async () => readMesh(meshUrl(session, resource), session, material);
  read().then(
    (mesh) => {
      group.add(mesh);
      redraw();
    },
    (error: Error) => session.note("warning", `${resource}: ${error.message}`),
  );
  return group;
}

const Z_UP = /<up_axis>\s*Z_UP\s*<\/up_axis>/;

/** A mesh; `material` is for those that bring none. Throws where it is not allowed, or none that can be read. */
export async function readMesh(url: URL, session: RobotSession, material: Material): Promise<Object3D> {
  if (!isAllowed(session, url)) {
    throw new Error(`${url.origin} is not the robot's server; the page can allow it with mesh-origins`);
  }
  // The token is for the robot's server alone, and a redirection must not lead elsewhere.
  const own = url.origin === new URL(session.httpBase).origin;
  const response = await fetch(url, { headers: own ? session.httpHeaders : {}, redirect: "error" });
  if (!response.ok) throw new Error((await response.text()).trim().slice(0, 200));
  const manager = guard(new LoadingManager(), session, url);
  const kind = url.pathname.split(".").at(-1)?.toLowerCase();
  if (kind === "stl") {
    const { STLLoader } = await import("three/addons/loaders/STLLoader.js");
    return new Mesh(new STLLoader().parse(await response.arrayBuffer()), material);
  }
  if (kind === "dae") {
    const { ColladaLoader } = await import("three/addons/loaders/ColladaLoader.js");
    const text = await response.text();
    // The loader turns what is Z-up, as robots' meshes are, and warns of it each time: it is turned here.
    const flat = text.replace(Z_UP, "<up_axis>Y_UP</up_axis>");
    const collada = new ColladaLoader(manager).parse(flat, new URL(".", url).href);
    if (!collada) throw new Error("this is no Collada file");
    if (flat !== text) collada.scene.rotation.x = -Math.PI / 2;
    return collada.scene;
  }
  if (kind === "obj") {
    const { OBJLoader } = await import("three/addons/loaders/OBJLoader.js");
    const object = new OBJLoader().parse(await response.text());
    object.traverse((each) => {
      if (each instanceof Mesh) each.material = material;
    });
    return object;
  }
  if (kind === "glb" || kind === "gltf") {
    const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
    const loaded = await new GLTFLoader(manager).parseAsync(
      await response.arrayBuffer(),
      new URL(".", url).href,
    );
    return loaded.scene;
  }
  throw new Error("served are .stl, .dae, .obj, .gltf and .glb");
}
