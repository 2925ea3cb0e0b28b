/** The drawn view: camera, light, ground, and a frame drawn only when something has changed, as finely as the machine can. */

import { signal } from "@preact/signals-core";
import {
  BufferGeometry,
  Color,
  DirectionalLight,
  Float32BufferAttribute,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  MathUtils,
  Object3D,
  PerspectiveCamera,
  Plane,
  Raycaster,
  Scene,
  Vector2,
  Vector3,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { CSS2DRenderer } from "three/addons/renderers/CSS2DRenderer.js";
import { type Detail, Governor } from "./governor";
import type { Quality } from "./quality";
import { Surface } from "./surface";

// ROS's frames have z up (REP 103).
Object3D.DEFAULT_UP.set(0, 0, 1);

const GROUND = new Plane(new Vector3(0, 0, 1), 0);

const FIELD_OF_VIEW = 50;

/** Scale of the library's point sizes to metres: the library ignores the field of view. */
export const METRE_OF_POINTS = 1 / Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180));

/** Milliseconds without a change after which a scene is drawn as finely as it can be. */
const REST = 700;

/** Objects whose materials are new, as something that the library can walk over. */
class Fresh extends Object3D {
  constructor(private readonly objects: readonly Object3D[]) {
    super();
  }

  override traverse(callback: (object: Object3D) => void): void {
    this.objects.forEach(callback);
  }

  override traverseVisible(): void {
    // Here it looks for lights, which are the scene's.
  }
}

export class View {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.05, 500);
  readonly controls: OrbitControls;
  readonly canvas: HTMLCanvasElement;
  /** Called before each frame that is drawn, with how finely it will be. */
  beforeDraw: (detail: Detail) => void = () => undefined;
  /** Frames that were drawn. */
  drawn = 0;

  private readonly surface: Surface;
  private readonly governor: Governor;
  private readonly labels = new CSS2DRenderer();
  private readonly grid = fadingGrid(20);
  /** True if the page is dark. */
  readonly dark = signal(false);
  private readonly sizes: ResizeObserver;
  private width = 0;
  private height = 0;
  /** Materials whose programs are compiled, or are about to be. */
  private readonly known = new WeakSet<object>();
  private isCompiling = false;
  private isDirty = true;
  /** True if nothing has changed for so long that the next frame is as fine as can be. */
  private isResting = false;
  private rest: ReturnType<typeof setTimeout> | undefined;
  /** True if the current frame counts for the draw time of a moving scene. */
  private isCounted = false;
  private isVisible = true;
  private frame = 0;

  /**
   * @param host where it is drawn
   * @param quality how finely
   * @throws Error the browser has no WebGL
   */
  constructor(
    private readonly host: HTMLElement,
    quality: Quality = "auto",
  ) {
    this.surface = new Surface({ antialias: quality !== "low", always: quality === "high" });
    this.surface.renderer.debug.checkShaderErrors = false; // To ask for them makes the page wait for the compiler.
    this.governor = new Governor(quality, Math.min(devicePixelRatio, 2), this.surface.isSoftware);
    this.canvas = this.surface.canvas;
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
    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.set(-3, -5, 10);
    const sky = new HemisphereLight(0xf4f8ff, 0x59616d, 1.5);
    sky.position.set(0, 0, 1);
    this.scene.add(sky, sun, this.grid);
    this.setDark(false);
    this.sizes = new ResizeObserver(() => this.resize());
    this.sizes.observe(host);
    this.resize();
  }

  /** Draw a frame when the browser next can. */
  redraw(): void {
    this.isDirty = true;
    this.isResting = false;
    this.schedule();
  }

  /** Set whether the view is visible; nothing is drawn while it is not. */
  setVisible(visible: boolean): void {
    this.isVisible = visible;
    this.redraw();
  }

  setDark(dark: boolean): void {
    this.dark.value = dark;
    this.scene.background = new Color(dark ? 0x0d1014 : 0xe9edf2);
    (this.grid.material as LineBasicMaterial).color.set(dark ? 0x39434f : 0xb7c1cc);
    this.redraw();
  }

  /** Look at a place from above, with x to the right. */
  lookFromAbove(x: number, y: number): void {
    // From as far as before: the way from the old place to the new one makes nothing smaller.
    const height = Math.max(8, this.camera.position.distanceTo(this.controls.target));
    this.controls.target.set(x, y, 0);
    // A hair off the vertical: straight down, no direction would be up.
    this.camera.position.set(x, y - 0.01, height);
    this.controls.update();
  }

  /** Look at a place obliquely. */
  lookAt(x: number, y: number): void {
    this.controls.target.set(x, y, 0.3);
    this.camera.position.set(x - 2.6, y - 2.6, 2.6);
    this.controls.update();
  }

  /** Look at the target from a direction, from as far as before. */
  lookAlong(x: number, y: number, z: number): void {
    const { position } = this.camera;
    const { target } = this.controls;
    const away = position.distanceTo(target);
    // A hair off the vertical: straight down, no direction would be up.
    position.copy(new Vector3(x, y - (x || y ? 0 : 0.001), z).setLength(away).add(target));
    this.controls.update();
  }

  /** True if the processor draws. */
  get isSoftware(): boolean {
    return this.surface.isSoftware;
  }

  /** Where the camera is, and what it looks at, in the fixed frame. */
  get viewpoint(): number[] {
    return [...this.camera.position.toArray(), ...this.controls.target.toArray()].map(
      (each) => Math.round(each * 1000) / 1000,
    );
  }

  set viewpoint(given: readonly number[]) {
    if (given.length !== 6 || !given.every(Number.isFinite)) return;
    this.camera.position.fromArray(given);
    this.controls.target.fromArray(given, 3);
    this.controls.update();
    this.redraw();
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
    this.isVisible = false;
    cancelAnimationFrame(this.frame);
    clearTimeout(this.rest);
    this.sizes.disconnect();
    this.controls.dispose();
    disposeTree(this.scene);
    this.surface.dispose();
    this.labels.domElement.remove();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.width = width;
    this.height = height;
    this.labels.setSize(width, height);
    this.redraw();
  }

  private schedule(): void {
    if (this.isVisible && !this.frame) this.frame = requestAnimationFrame(this.tick);
  }

  private readonly tick = () => {
    this.frame = 0;
    const took = this.surface.finish();
    if (took !== null) {
      this.drawn++;
      if (this.isCounted) this.governor.drew(took);
    }
    if (!this.surface.isBusy && !this.isCompiling && (this.isDirty || this.isResting)) this.draw();
    if (this.surface.isBusy || (this.isDirty && !this.isCompiling)) this.schedule();
  };

  private draw(): void {
    if (!this.width) {
      this.isDirty = false; // A new size asks again.
      return;
    }
    const { best } = this.governor;
    const { isResting } = this;
    const detail = isResting ? best : this.governor.detail;
    this.beforeDraw(detail);
    if (this.compile()) return;
    this.surface.draw(this.scene, this.camera, this.width, this.height, detail.ratio);
    this.labels.render(this.scene, this.camera);
    this.isCounted = !isResting;
    this.isDirty = this.isResting = false;
    clearTimeout(this.rest);
    if (detail === best) return;
    this.rest = setTimeout(() => {
      this.isResting = true;
      this.schedule();
    }, REST);
  }

  /** Begin to compile what new materials need, which the page's thread would wait for otherwise; whether there is anything. */
  private compile(): boolean {
    const fresh: Object3D[] = [];
    this.scene.traverseVisible((object) => {
      const { material } = object as Object3D & { material?: object };
      if (!material || this.known.has(material)) return;
      this.known.add(material);
      fresh.push(object);
    });
    if (!fresh.length) return false;
    this.isCompiling = true;
    this.surface.renderer.compileAsync(new Fresh(fresh), this.camera, this.scene).then(() => {
      this.isCompiling = false;
      this.schedule();
    });
    return true;
  }
}

/** Lines a metre apart on the ground, which fade towards the edge. */
function fadingGrid(reach: number): LineSegments {
  const positions: number[] = [];
  const colours: number[] = [];
  for (let line = -reach; line <= reach; line++) {
    for (let from = -reach; from < reach; from++) {
      for (const along of [from, from + 1]) {
        positions.push(line, along, 0);
        colours.push(1, 1, 1, Math.max(0, 1 - Math.hypot(line, along) / reach));
      }
    }
  }
  const count = positions.length;
  for (let at = 0; at < count; at += 3)
    positions.push(positions[at + 1] as number, positions[at] as number, 0);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(positions, 3));
  geometry.setAttribute("color", new Float32BufferAttribute([...colours, ...colours], 4));
  return new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true, transparent: true }));
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
