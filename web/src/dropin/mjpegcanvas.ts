/** The global `MJPEGCANVAS`: shows pictures of a `web_video_server` on a canvas, as mjpegcanvasjs did. */

import { EventEmitter2 } from "eventemitter2";

export const REVISION = "0.5.0";

export interface ViewerOptions {
  /** The element to put the canvas into. */
  divID: string;
  /** Pixels. */
  width: number;
  height: number;
  /** Where the `web_video_server` is. */
  host: string;
  /** By default 8080. */
  port?: number;
  /** 1 to 100; by default the server's. */
  quality?: number;
  /** The topic of the camera. */
  topic: string;
  /** A canvas to draw on top of each picture. */
  overlay?: HTMLCanvasElement;
  /** Drawings a second, at most; by default 10. */
  refreshRate?: number;
  /** Milliseconds from one drawing to the next, at least; by default 30. */
  interval?: number;
  /** Rotate the picture by 180°. */
  invert?: boolean;
  /** Use `https`; the default is the protocol of the page. */
  ssl?: boolean;
}

/** Milliseconds after which a stream that cannot be had is asked for again. */
export const RETRY_AFTER = 2000;

/** A picture without a source of its own: its width is 0 until the first of a stream is there. */
function hasPicture(image: HTMLImageElement): boolean {
  return image.width * image.height > 0;
}

/**
 * Shows one topic.
 *
 * Emits `change` with the topic when it is changed, and `warning` with each drawing for which there is no picture.
 */
export class Viewer extends EventEmitter2 {
  width: number;
  height: number;
  host: string;
  port: number;
  quality: number | undefined;
  refreshRate: number;
  interval: number;
  invert: boolean;
  /** Drawn image; a new one for each stream. */
  image = new Image();
  readonly canvas = document.createElement("canvas");

  readonly #scheme: string;
  readonly #overlay: HTMLCanvasElement | undefined;

  constructor(options: ViewerOptions) {
    super();
    this.width = options.width;
    this.height = options.height;
    this.host = options.host;
    this.port = options.port || 8080;
    this.quality = options.quality;
    this.refreshRate = options.refreshRate || 10;
    this.interval = options.interval || 30;
    this.invert = options.invert || false;
    this.#scheme = (options.ssl ?? location.protocol === "https:") ? "https" : "http";
    this.#overlay = options.overlay;

    const parent = document.getElementById(options.divID);
    if (parent === null) throw new Error(`MJPEGCANVAS: the page has no element with the id ${options.divID}`);
    this.canvas.width = this.width;
    this.canvas.height = this.height;
    this.canvas.style.background = "#aaaaaa";
    this.canvas.setAttribute("role", "img");
    parent.appendChild(this.canvas);

    this.changeStream(options.topic);
    setInterval(() => this.#draw(), Math.max(1000 / this.refreshRate, this.interval));
  }

  /** Shows another topic. */
  changeStream(topic: string): void {
    // A name can have no character that a URL gives a meaning to; what is no name must not add parameters.
    const name = encodeURIComponent(topic).replaceAll("%2F", "/");
    let url = `${this.#scheme}://${this.host}:${this.port}/stream?topic=${name}`;
    url += `&width=${this.width}&height=${this.height}`;
    if (this.quality !== undefined && this.quality > 0) url += `&quality=${this.quality}`;
    if (this.invert) url += "&invert=true";
    const image = new Image();
    image.addEventListener("error", () => {
      setTimeout(() => {
        if (this.image === image) image.src = url;
      }, RETRY_AFTER);
    });
    // A connection is only closed when its picture gets another source.
    this.image.src = "";
    this.image = image;
    image.src = url;
    this.canvas.setAttribute("aria-label", `Camera ${topic}`);
    this.emit("change", topic);
  }

  #draw(): void {
    const context = this.canvas.getContext("2d");
    if (context === null) return;
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (hasPicture(this.image)) {
      context.drawImage(this.image, 0, 0, this.width, this.height);
    } else {
      drawCrossedCamera(context, this.width, this.height);
      this.emit("warning", "Invalid stream.");
    }
    if (this.#overlay) context.drawImage(this.#overlay, 0, 0);
  }
}

/** Says by a picture that there is none. */
function drawCrossedCamera(context: CanvasRenderingContext2D, width: number, height: number): void {
  const side = Math.min(width, height) / 4;
  context.save();
  context.translate(width / 2, height / 2);
  context.fillStyle = "#444444";
  context.fillRect(-side, -side * 0.5, side * 1.4, side);
  context.beginPath();
  context.moveTo(side * 0.4, 0);
  context.lineTo(side, -side * 0.45);
  context.lineTo(side, side * 0.45);
  context.fill();
  context.strokeStyle = "#c00000";
  context.lineWidth = side / 6;
  context.beginPath();
  context.moveTo(-side, side * 0.9);
  context.lineTo(side, -side * 0.9);
  context.stroke();
  context.restore();
}

export interface MultiStreamViewerOptions extends Omit<ViewerOptions, "topic" | "overlay"> {
  /** The topics to choose from. */
  topics: string[];
  /** Label of each; the default is its name. */
  labels?: string[];
  /** Which to begin with; by default 0. */
  defaultStream?: number;
}

/**
 * Shows one of several topics, and lets the user choose.
 *
 * Emits what its {@link Viewer} does. A button appears on the picture under the mouse, and when it has the focus; it
 * opens a list of the streams.
 */
export class MultiStreamViewer extends EventEmitter2 {
  /** The canvas of the stream. */
  readonly canvas: HTMLCanvasElement;

  constructor(options: MultiStreamViewerOptions) {
    super();
    const { topics, labels, defaultStream = 0, ...others } = options;
    const topic = topics[defaultStream];
    if (topic === undefined) {
      throw new Error(`MJPEGCANVAS: defaultStream is ${defaultStream}, of ${topics.length} topics`);
    }
    const viewer = new Viewer({ ...others, topic });
    this.canvas = viewer.canvas;
    viewer.on("warning", (warning: string) => this.emit("warning", warning));
    viewer.on("change", (name: string) => this.emit("change", name));

    // The button and the menu lie on the canvas.
    const frame = document.createElement("div");
    Object.assign(frame.style, { position: "relative", display: "inline-block" });
    viewer.canvas.replaceWith(frame);
    frame.append(viewer.canvas, ...this.#controls(viewer, topics, labels ?? topics, topic));
  }

  #controls(viewer: Viewer, topics: string[], labels: string[], topic: string): HTMLElement[] {
    const edit = document.createElement("button");
    edit.type = "button";
    edit.textContent = "Edit";
    Object.assign(edit.style, { position: "absolute", left: "10px", bottom: "14px", opacity: "0" });
    edit.style.font = `${Math.max(12, viewer.height / 14)}px Verdana, sans-serif`;

    const menu = document.createElement("div");
    menu.hidden = true;
    Object.assign(menu.style, {
      position: "absolute",
      inset: "0",
      padding: "1em",
      background: "#fefefecc",
      color: "#111111",
    });
    const heading = document.createElement("h2");
    heading.textContent = "Camera Streams";
    const label = document.createElement("label");
    label.textContent = "Stream: ";
    const list = document.createElement("select");
    list.name = "stream";
    topics.forEach((name, index) => {
      const option = document.createElement("option");
      option.value = name;
      option.textContent = labels[index] ?? name;
      option.selected = name === topic;
      list.append(option);
    });
    label.append(list);
    const close = document.createElement("button");
    close.type = "button";
    close.textContent = "Close";
    menu.append(heading, label, " ", close);

    const show = (open: boolean) => {
      menu.hidden = !open;
      edit.hidden = open;
      (open ? list : edit).focus();
    };
    edit.addEventListener("click", () => show(true));
    close.addEventListener("click", () => show(false));
    list.addEventListener("change", () => viewer.changeStream(list.value));

    let timer: ReturnType<typeof setTimeout> | undefined;
    const reveal = () => {
      edit.style.opacity = "1";
      clearTimeout(timer);
      timer = setTimeout(() => {
        if (document.activeElement !== edit) edit.style.opacity = "0";
      }, 3000);
    };
    viewer.canvas.addEventListener("pointermove", reveal);
    viewer.canvas.addEventListener("pointerdown", reveal);
    edit.addEventListener("pointermove", reveal);
    edit.addEventListener("focus", reveal);
    edit.addEventListener("blur", reveal);
    return [edit, menu];
  }
}
