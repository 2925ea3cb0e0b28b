/** Surface of a scene: a canvas of the graphics card, or one whose pixels are fetched when they are done. */

import { type Camera, type Scene, WebGLRenderer } from "three";

/** Names of renderers that are programs, and no graphics card. */
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/** True if this browser draws in software; null before the first surface was made. */
let isKnownSoftware: boolean | null = null;

/** Options of a canvas. */
export interface SurfaceOptions {
  /** True if edges are smoothed where a graphics card draws. */
  antialias: boolean;
  /** True if edges are smoothed where the processor draws, too, which doubles the work. */
  always: boolean;
}

/**
 * One frame at a time is drawn, and the page's thread never waits for it.
 *
 * Where a graphics card draws, its canvas is the one that is shown. Where the processor does, a browser that shows
 * such a canvas makes the page's thread wait until the frame is done: there the frame is drawn out of sight, its
 * pixels are copied by the renderer itself, and put into a plain canvas when a fence says that they are there.
 */
export class Surface {
  /** Visible element, which receives pointer events. */
  readonly canvas: HTMLCanvasElement;
  readonly renderer: WebGLRenderer;
  /** True if the processor draws. */
  readonly isSoftware: boolean;

  private readonly gl: WebGL2RenderingContext;
  private readonly picture: CanvasRenderingContext2D | null = null;
  private fence: WebGLSync | null = null;
  private began = 0;
  /** When it was last seen not to be done. */
  private unfinished = 0;
  private pixels: WebGLBuffer | null = null;
  private fetched = new Uint8Array(0);
  private image: ImageData | null = null;
  private readonly lost = () => {
    this.fence = this.pixels = null;
  };

  /** Throws where the browser has no WebGL. */
  constructor({ antialias, always }: SurfaceOptions) {
    const shown = document.createElement("canvas");
    let gl = isKnownSoftware ? null : context(shown, antialias);
    if (gl) isKnownSoftware = SOFTWARE.test(nameOf(gl));
    this.isSoftware = isKnownSoftware ?? false;
    this.canvas = shown;
    if (this.isSoftware) {
      gl?.getExtension("WEBGL_lose_context")?.loseContext();
      gl = context(new OffscreenCanvas(1, 1), antialias && always);
      this.canvas = document.createElement("canvas");
      this.picture = this.canvas.getContext("2d", { alpha: false });
    }
    if (!gl) throw new Error("the browser offers no WebGL 2");
    this.gl = gl;
    this.renderer = new WebGLRenderer({ canvas: gl.canvas as HTMLCanvasElement, context: gl });
    gl.canvas.addEventListener("webglcontextlost", this.lost);
  }

  /** True if a frame is being drawn. */
  get isBusy(): boolean {
    return this.fence !== null;
  }

  /** Draw a frame of so many pixels of the page, with so many pixels for each. */
  draw(scene: Scene, camera: Camera, width: number, height: number, ratio: number): void {
    const { renderer, gl, canvas } = this;
    canvas.style.width = `${width}px`;
    canvas.style.height = `${height}px`;
    const [across, down] = [Math.floor(width * ratio), Math.floor(height * ratio)];
    if (gl.canvas.width !== across || gl.canvas.height !== down || renderer.getPixelRatio() !== ratio) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(width, height, false);
    }
    renderer.render(scene, camera);
    if (this.picture) this.copy();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.began = this.unfinished = performance.now();
  }

  /** Show the frame that was begun, if it is done by now; the milliseconds that it took at least, else null. */
  finish(): number | null {
    const { gl, fence } = this;
    if (!fence) return null;
    if (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) {
      this.unfinished = performance.now();
      return null;
    }
    gl.deleteSync(fence);
    this.fence = null;
    if (this.picture) this.show(this.picture);
    return this.unfinished - this.began;
  }

  dispose(): void {
    this.gl.canvas.removeEventListener("webglcontextlost", this.lost);
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }

  /** Have the pixels copied to where they can be fetched from. */
  private copy(): void {
    const { gl } = this;
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    this.pixels ??= gl.createBuffer();
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, this.pixels);
    if (this.image?.width !== width || this.image.height !== height) {
      this.image = new ImageData(width, height);
      this.fetched = new Uint8Array(width * height * 4);
    }
    // A new one each time: the one before may be in use, and this is what a stream is said to be.
    gl.bufferData(gl.PIXEL_PACK_BUFFER, this.fetched.byteLength, gl.STREAM_READ);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, 0);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  }

  private show(picture: CanvasRenderingContext2D): void {
    const { gl, pixels, fetched, image, canvas } = this;
    if (!pixels || !image) return;
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, pixels);
    gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, fetched);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    // WebGL begins below.
    const row = image.width * 4;
    for (let from = fetched.length - row, to = 0; from >= 0; from -= row, to += row)
      image.data.set(fetched.subarray(from, from + row), to);
    if (canvas.width !== image.width || canvas.height !== image.height) {
      canvas.width = image.width;
      canvas.height = image.height;
    }
    picture.putImageData(image, 0, 0);
  }
}

function context(canvas: HTMLCanvasElement | OffscreenCanvas, antialias: boolean) {
  return canvas.getContext("webgl2", {
    antialias,
    powerPreference: "high-performance",
  }) as WebGL2RenderingContext | null;
}

/** Name of the renderer in the browser. */
function nameOf(gl: WebGL2RenderingContext): string {
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  return String(gl.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
}
