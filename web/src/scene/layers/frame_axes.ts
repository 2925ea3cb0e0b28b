/** The tf tree: axes of every frame, lines to their parents, and their names. */

import { AxesHelper, BufferGeometry, Line, LineBasicMaterial, Object3D, Vector3 } from "three";
import { CSS2DObject } from "three/addons/renderers/CSS2DRenderer.js";
import { fixed } from "../../i18n/formats";
import { plain } from "../../i18n/plain";
import type { Frames } from "../frames";
import { disposeTree, type View } from "../view";

/** Frames that are drawn at most. */
const MOST = 300;

interface Drawn {
  holder: Object3D;
  axes: Object3D;
  label: HTMLElement;
  line: Line;
}

/** What is drawn of frames, and metres of their axes. */
export interface AxesSettings {
  axes: boolean;
  names: boolean;
  ages: boolean;
  size: number;
}
export const USUAL_AXES: AxesSettings = { axes: true, names: true, ages: false, size: 0.25 };

export class FrameAxes {
  private readonly drawn = new Map<string, Drawn>();
  private shown = false;
  private settings = USUAL_AXES;

  constructor(
    private readonly frames: Frames,
    private readonly view: View,
  ) {}

  get isShown(): boolean {
    return this.shown;
  }

  show(shown: boolean): void {
    this.shown = shown;
    this.update();
    this.view.redraw();
  }

  configure(settings: AxesSettings): void {
    this.settings = settings;
    this.view.redraw();
  }

  /** Follow the frames; called before each drawn frame. */
  update(): void {
    if (!this.shown) {
      for (const name of [...this.drawn.keys()]) this.remove(name);
      return;
    }
    const names = this.frames.names.slice(0, MOST);
    for (const name of [...this.drawn.keys()]) if (!names.includes(name)) this.remove(name);
    for (const name of names) {
      const { holder, axes, label, line } = this.drawn.get(name) ?? this.add(name);
      const frame = this.frames.tree.get(name);
      const parent = frame?.parent;
      axes.visible = this.settings.axes;
      axes.scale.setScalar(this.settings.size);
      const age = this.settings.ages && frame && !frame.isStatic ? ageText(frame.at) : "";
      label.textContent = plain([this.settings.names ? name : "", age].filter(Boolean).join(" "));
      label.hidden = label.textContent === "";
      const here = this.frames.inFixed(name);
      const there = parent === undefined ? null : this.frames.inFixed(parent);
      holder.visible = here !== null;
      line.visible = this.settings.axes && here !== null && there !== null;
      if (here && there) {
        const ends = [here, there].map((matrix) => new Vector3().setFromMatrixPosition(matrix));
        line.geometry.setFromPoints(ends);
      }
    }
  }

  dispose(): void {
    this.shown = false;
    this.update();
  }

  private add(name: string): Drawn {
    const holder = new Object3D();
    const label = document.createElement("span");
    label.className = "scene-name";
    const axes = new AxesHelper(1);
    holder.add(axes, new CSS2DObject(label));
    this.frames.place(name).add(holder);
    const line = new Line(new BufferGeometry(), new LineBasicMaterial({ color: 0xd9a514 }));
    line.frustumCulled = false;
    this.view.scene.add(line);
    const drawn = { holder, axes, label, line };
    this.drawn.set(name, drawn);
    return drawn;
  }

  private remove(name: string): void {
    const drawn = this.drawn.get(name);
    if (!drawn) return;
    for (const object of [drawn.holder, drawn.line]) {
      disposeTree(object);
      object.removeFromParent();
    }
    this.drawn.delete(name);
  }
}

/** Time since a transform arrived. */
function ageText(at: number): string {
  return `${fixed((Date.now() - at) / 1000, 1)} s`;
}
