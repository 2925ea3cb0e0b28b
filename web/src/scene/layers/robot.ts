/** The robot's model: a URDF with its meshes, moved by /joint_states. */

import { Group, LoadingManager, type Mesh, type Object3D } from "three";
import URDFLoader, { type URDFRobot } from "urdf-loader";
import type { Message } from "../../robot/subscriptions";
import { Layer, type LayerContext } from "./layer";
import { guard, readMesh } from "./meshes";

const MOST_TEXT = 16 * 1024 * 1024;

export class RobotLayer extends Layer {
  private robot: URDFRobot | null = null;
  private text = "";
  /** Collision shapes are loaded when they are wanted first. */
  private parsesCollision = false;

  constructor(context: LayerContext) {
    super(context);
    this.options.value = [
      { kind: "switch", name: "visual", usual: true },
      { kind: "switch", name: "collision", usual: false },
      { kind: "number", name: "opacity", least: 10, most: 100, step: 5, unit: "%", usual: 100 },
    ];
    this.hear((message) => this.build(String(message.data ?? "")));
    if (context.session.graph.peek().topics.has("/joint_states")) {
      this.hear((message) => this.move(message), { throttle: 50 }, "/joint_states");
    }
  }

  private build(text: string): void {
    if (text === this.text) return;
    this.text = text;
    this.clear();
    this.robot = null;
    if (text.length > MOST_TEXT) throw new Error(`a description of ${text.length} characters is too long`);
    if (!/<robot[\s>]/.test(text)) throw new Error("the description is no URDF: expected <robot> with links");
    const document = new DOMParser().parseFromString(text, "application/xml");
    const wrong = document.querySelector("parsererror");
    if (wrong) throw new Error(`the description is no XML: ${wrong.textContent?.slice(0, 200)}`);
    if (document.documentElement.nodeName !== "robot" || !document.querySelector("link")) {
      throw new Error("the description is no URDF: expected <robot> with links");
    }
    const { session, view } = this.context;
    const missing = new Set<string>();
    const manager = new LoadingManager(
      () => view.redraw(),
      () => view.redraw(),
      (url) => {
        missing.add(url);
        this.text = ""; // When the description comes again, as after a lost connection, they are asked for again.
        this.problem.value = `${missing.size} of its files cannot be loaded, as ${url}`;
      },
    );
    const loader = new URDFLoader(guard(manager, session, new URL(session.httpBase)));
    loader.parseCollision = this.parsesCollision;
    loader.packages = (name) => new URL(`packages/${name}`, session.httpBase).href;
    // The library's own loaders show no token.
    loader.loadMeshCb = (url, _, material, done) => {
      readMesh(new URL(url, session.httpBase), session, material).then(
        (mesh) => {
          done(mesh);
          this.configured();
          view.redraw();
        },
        (error: Error) => {
          manager.itemError(url);
          done(new Group(), error);
        },
      );
    };
    const robot = loader.parse(document);
    this.robot = robot;
    this.group.add(robot);
    this.configured();
    this.moveTo(rootLink(document));
  }

  protected override configured(): void {
    if (this.setting("collision") && !this.parsesCollision) {
      const { text } = this;
      this.parsesCollision = true;
      this.text = "";
      if (text) this.build(text);
    }
    const shown = { isURDFVisual: this.setting("visual"), isURDFCollider: this.setting("collision") };
    const opacity = Number(this.setting("opacity")) / 100;
    this.robot?.traverse((object) => {
      for (const [kind, isShown] of Object.entries(shown))
        if (kind in object) object.visible = isShown === true;
      const isCollider = hasAbove(object, "isURDFCollider");
      for (const material of [(object as Mesh).material ?? []].flat()) {
        if (isCollider) Object.assign(material, { wireframe: true });
        material.userData.opacity ??= material.opacity;
        material.opacity = material.userData.opacity * opacity;
        material.transparent = material.opacity < 1;
      }
    });
  }

  private move(message: Message): void {
    const names = message.name as string[];
    const positions = message.position as ArrayLike<number>;
    names.forEach((name, at) => {
      const position = positions[at];
      if (typeof position === "number" && Number.isFinite(position))
        this.robot?.joints[name]?.setJointValue(position);
    });
  }
}

/** True if an object or one above it has a mark. */
function hasAbove(object: Object3D | null, mark: string): boolean {
  return object !== null && (mark in object || hasAbove(object.parent, mark));
}

/** The link that is no joint's child. */
export function rootLink(document: Document): string {
  const children = new Set(
    [...document.querySelectorAll("robot > joint > child")].map((child) => child.getAttribute("link")),
  );
  const links = [...document.querySelectorAll("robot > link")].map((link) => link.getAttribute("name") ?? "");
  return links.find((link) => !children.has(link)) ?? "";
}
