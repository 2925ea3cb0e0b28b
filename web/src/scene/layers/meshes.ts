/** Meshes by the names that robots give them: `package://…` and URLs, as STL, Collada, OBJ or glTF. */

import { Group, type Material, Mesh, type Object3D } from "three";
import type { RobotSession } from "../../robot/session";

/** Where a file of a robot is served; only what the robot's own server serves can be loaded. */
export function meshUrl(session: RobotSession, resource: string): URL {
  const found = /^package:\/\/(.*)$/.exec(resource);
  return found ? new URL(`packages/${found[1]}`, session.httpBase) : new URL(resource, session.httpBase);
}

/** An empty group that the mesh appears in when it has come; `redraw` is called then. */
export function loadMesh(
  session: RobotSession,
  resource: string,
  material: Material,
  redraw: () => void,
): Object3D {
  const group = new Group();
  readMesh(meshUrl(session, resource), session, material).then(
    (mesh) => {
      group.add(mesh);
      redraw();
    },
    (error: Error) => session.note("warning", `${resource}: ${error.message}`),
  );
  return group;
}

/** A mesh from the robot's server; `material` is for those that bring none. Throws where there is none that can be read. */
export async function readMesh(url: URL, session: RobotSession, material: Material): Promise<Object3D> {
  const response = await fetch(url, { headers: session.httpHeaders });
  if (!response.ok) throw new Error((await response.text()).trim().slice(0, 200));
  const kind = url.pathname.split(".").at(-1)?.toLowerCase();
  if (kind === "stl") {
    const { STLLoader } = await import("three/addons/loaders/STLLoader.js");
    return new Mesh(new STLLoader().parse(await response.arrayBuffer()), material);
  }
  if (kind === "dae") {
    const { ColladaLoader } = await import("three/addons/loaders/ColladaLoader.js");
    const collada = new ColladaLoader().parse(await response.text(), new URL(".", url).href);
    if (!collada) throw new Error("this is no Collada file");
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
    const loaded = await new GLTFLoader().parseAsync(await response.arrayBuffer(), new URL(".", url).href);
    return loaded.scene;
  }
  throw new Error("served are .stl, .dae, .obj, .gltf and .glb");
}
