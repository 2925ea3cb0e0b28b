/** The drawn view: camera, light, ground, and a frame drawn only when something has changed. */

import {
  AmbientLight,
  Color,
  DirectionalLight,
  GridHelper,
  MathUtils,
  Object3D,
  PerspectiveCamera,
  Plane,
  Raycaster,
  Scene,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { CSS2DRenderer } from "three/addons/renderers/CSS2DRenderer.js";

// ROS's frames have z up (REP 103).
Object3D.DEFAULT_UP.set(0, 0, 1);

const GROUND = new Plane(new Vector3(0, 0, 1), 0);

const FIELD_OF_VIEW = 50;

/** What the library's points are to be asked for so that they are as large as one metre is: it leaves the field of view out. */
export const METRE_OF_POINTS = 1 / Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180));

export class View {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.05, 500);
  readonly controls: OrbitControls;
  readonly canvas: HTMLCanvasElement;
  /** Called before each frame that is drawn. */
  beforeDraw: () => void = () => undefined;
  /** Frames that were drawn. */
  drawn = 0;

  private readonly renderer: WebGLRenderer;
  private readonly labels = new CSS2DRenderer();
  private readonly grid = new GridHelper(40, 40);
  private readonly sizes: ResizeObserver;
  private dirty = true;
  private visible = true;
  private frame = 0;

  /** Throws where the browser has no WebGL. */
  constructor(private readonly host: HTMLElement) {
    this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "high-performance" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.canvas = this.renderer.domElement;
    this.labels.domElement.className = "scene-labels";
    host.append(this.canvas, this.labels.domElement);
    this.camera.position.set(-5, -4, 6);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.maxPolarAngle = MathUtils.degToRad(89);
    this.controls.minDistance = 0.3;
    this.controls.maxDistance = 200;
    this.controls.addEventListener("change", () => this.redraw());
    this.canvas.tabIndex = 0;
    this.controls.listenToKeyEvents(this.canvas);
    this.grid.rotation.x = Math.PI / 2;
    const sun = new DirectionalLight(0xffffff, 1.8);
    sun.position.set(-3, -5, 10);
    this.scene.add(new AmbientLight(0xffffff, 1.4), sun, this.grid);
    this.sizes = new ResizeObserver(() => this.resize());
    this.sizes.observe(host);
    this.resize();
    this.frame = requestAnimationFrame(this.tick);
  }

  /** Draw a frame when the browser next can. */
  redraw(): void {
    this.dirty = true;
  }

  setVisible(visible: boolean): void {
    this.visible = visible;
    this.redraw();
  }

  setDark(dark: boolean): void {
    // Lighter than the page when dark: the walls of maps are black.
    this.scene.background = new Color(dark ? 0x38414b : 0xdfe5ec);
    const material = this.grid.material as { color: Color; vertexColors: boolean; needsUpdate: boolean };
    material.vertexColors = false;
    material.color = new Color(dark ? 0x4d5863 : 0xb4bdc8);
    material.needsUpdate = true;
    this.redraw();
  }

  /** Look at a place from above, with x to the right. */
  lookFromAbove(x: number, y: number): void {
    this.controls.target.set(x, y, 0);
    // A hair off the vertical: straight down, no direction would be up.
    this.camera.position.set(x, y - 0.01, Math.max(8, this.camera.position.distanceTo(this.controls.target)));
    this.controls.update();
  }

  /** Look at a place obliquely. */
  lookAt(x: number, y: number): void {
    this.controls.target.set(x, y, 0.3);
    this.camera.position.set(x - 2.6, y - 2.6, 2.6);
    this.controls.update();
  }

  /** Move camera and target together. */
  follow(dx: number, dy: number): void {
    this.camera.position.x += dx;
    this.camera.position.y += dy;
    this.controls.target.x += dx;
    this.controls.target.y += dy;
    this.controls.update();
  }

  /** A ray through a point of the page, in pixels of the window. */
  ray(clientX: number, clientY: number): Raycaster {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector2(
      ((clientX - box.left) / box.width) * 2 - 1,
      1 - ((clientY - box.top) / box.height) * 2,
    );
    const ray = new Raycaster();
    ray.setFromCamera(at, this.camera);
    return ray;
  }

  /** Where the ground is at a point of the page; null above the horizon. */
  ground(clientX: number, clientY: number): Vector3 | null {
    return this.ray(clientX, clientY).ray.intersectPlane(GROUND, new Vector3());
  }

  /** Where a point of the fixed frame is drawn, in pixels of the window. */
  pixel(point: Vector3): { x: number; y: number } {
    this.camera.updateMatrixWorld();
    const box = this.canvas.getBoundingClientRect();
    const { x, y } = point.clone().project(this.camera);
    return { x: box.left + ((x + 1) / 2) * box.width, y: box.top + ((1 - y) / 2) * box.height };
  }

  dispose(): void {
    cancelAnimationFrame(this.frame);
    this.sizes.disconnect();
    this.controls.dispose();
    disposeTree(this.scene);
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
    this.labels.domElement.remove();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height);
    this.labels.setSize(width, height);
    this.redraw();
  }

  private readonly tick = () => {
    this.frame = requestAnimationFrame(this.tick);
    if (!this.dirty || !this.visible) return;
    this.dirty = false;
    this.drawn++;
    this.beforeDraw();
    this.renderer.render(this.scene, this.camera);
    this.labels.render(this.scene, this.camera);
  };
}

interface Disposable {
  dispose?: () => void;
}

/** Give back what a tree of objects holds in the graphics card. */
export function disposeTree(root: Object3D): void {
  root.traverse((object) => {
    const { geometry, material } = object as Object3D & {
      geometry?: Disposable;
      material?: Disposable | Disposable[];
    };
    geometry?.dispose?.();
    for (const each of Array.isArray(material) ? material : [material]) {
      for (const value of Object.values(each ?? {})) {
        if ((value as { isTexture?: boolean } | null)?.isTexture) (value as Disposable).dispose?.();
      }
      each?.dispose?.();
    }
    // Labels are elements of the page.
    (object as { element?: HTMLElement }).element?.remove();
  });
}
