/** A camera as a video track of a peer connection (WHEP): the pictures of a topic, with the delay of the network. */

import type { RobotSession } from "./session";

const SDP = "application/sdp";
const FRAGMENT = "application/trickle-ice-sdpfrag";
/** Milliseconds until a server has to answer, and until a peer has to be connected. */
const ANSWER = 5000;
const CONNECT = 8000;

/** Ticks a second of the media clock of video, and those after which its timestamps begin anew. */
const RTP_RATE = 90_000;
const RTP_RANGE = 2 ** 32;

interface FrameOfConnection extends VideoFrame {
  metadata?(): { rtpTimestamp?: number };
}

/** Response of a server to a rejected offer. */
export class WhepRefused extends Error {
  constructor(
    readonly status: number,
    text: string,
  ) {
    super(text);
  }

  /** True if the same offer may be accepted later: the server was full. */
  get isForNow(): boolean {
    return this.status === 503 || this.status === 429;
  }
}

/** Parts of "MediaStreamTrack Insertable Streams" in Chromium and Safari, which TypeScript does not declare. */
declare const MediaStreamTrackProcessor:
  | (new (init: {
      track: MediaStreamTrack;
    }) => { readable: ReadableStream<VideoFrame> })
  | undefined;

/** Return true if this browser supports WHEP. */
export function canWatch(): boolean {
  return typeof RTCPeerConnection === "function" && "requestVideoFrameCallback" in HTMLVideoElement.prototype;
}

/** One viewing, from the offer to its end. */
export class WhepViewer {
  private readonly connection: RTCPeerConnection;
  private readonly video = document.createElement("video");
  private readonly early: RTCIceCandidate[] = [];
  private location: URL | null = null;
  private patience: ReturnType<typeof setTimeout> | undefined;
  private over = false;
  private lastRtp = 0;
  private rtpRounds = 0;

  /**
   * @param session the robot
   * @param topic of pictures
   * @param onPicture is called with each picture while it can be drawn, and its time in seconds by the sender's media
   *   clock; NaN where the browser does not tell
   * @param onEnd is called once, where it ends by itself or does not come about
   */
  constructor(
    private readonly session: RobotSession,
    topic: string,
    private readonly onPicture: (
      picture: CanvasImageSource,
      width: number,
      height: number,
      time: number,
    ) => void,
    private readonly onEnd: (error: Error) => void,
  ) {
    this.connection = new RTCPeerConnection();
    this.video.muted = true;
    this.video.playsInline = true;
    this.patience = setTimeout(() => this.fail(new Error("no path to the robot was found")), CONNECT);
    this.watch(topic).catch((error: Error) => this.fail(error));
  }

  /** Look no longer. */
  close(): void {
    if (this.over) return;
    this.over = true;
    clearTimeout(this.patience);
    // A peer that is connected tells the other of its end.
    if (this.connection.connectionState !== "connected") this.release();
    this.connection.close();
    this.video.srcObject = null;
  }

  /** End at the server what would wait there for a path. */
  private release(): void {
    if (!this.location) return;
    fetch(this.location, { method: "DELETE", headers: this.session.httpHeaders, keepalive: true }).catch(
      (error: Error) => console.debug("a video could not be ended:", error.message),
    );
  }

  private fail(error: Error): void {
    if (this.over) return;
    this.close();
    this.onEnd(error);
  }

  private async watch(topic: string): Promise<void> {
    const { connection, session } = this;
    connection.setConfiguration(await this.servers());
    if (this.over) return;
    const { receiver } = connection.addTransceiver("video", { direction: "recvonly" });
    // A robot is driven by what is seen: what comes late is not worth waiting for.
    if ("jitterBufferTarget" in receiver) receiver.jitterBufferTarget = 0;
    connection.ontrack = ({ track }) => this.play(track);
    connection.onconnectionstatechange = () => this.changed();
    connection.onicecandidate = ({ candidate }) => candidate && this.offerCandidate(candidate);
    await connection.setLocalDescription();
    const url = new URL("whep", session.httpBase);
    url.search = `?topic=${encodeURIComponent(topic)}`;
    const answer = await fetch(url, {
      method: "POST",
      headers: { ...session.httpHeaders, "Content-Type": SDP },
      body: connection.localDescription?.sdp ?? "",
      signal: AbortSignal.timeout(ANSWER),
    });
    const text = await answer.text();
    if (answer.status !== 201) throw new WhepRefused(answer.status, text.trim() || `HTTP ${answer.status}`);
    // Behind a proxy the address names the path from the root of what the proxy serves.
    const location = answer.headers.get("Location");
    this.location = location ? new URL(location, url) : null;
    if (this.over) {
      this.release();
      return;
    }
    await connection.setRemoteDescription({ type: "answer", sdp: text });
    for (const candidate of this.early.splice(0)) this.offerCandidate(candidate);
  }

  /** The STUN and TURN servers that the robot names. */
  private async servers(): Promise<RTCConfiguration> {
    const { httpBase, httpHeaders } = this.session;
    const signal = AbortSignal.timeout(ANSWER);
    const answer = await fetch(new URL("webrtc", httpBase), { headers: httpHeaders, signal });
    if (!answer.ok) throw new WhepRefused(answer.status, (await answer.text()).trim());
    const { iceServers } = (await answer.json()) as RTCConfiguration;
    return { iceServers: iceServers ?? [] };
  }

  /** Candidates that are found after the offer went out. Those of `.local` are of no use to the robot. */
  private offerCandidate(candidate: RTCIceCandidate): void {
    if (!candidate.candidate || candidate.address?.endsWith(".local") || candidate.protocol !== "udp") return;
    if (!this.location) {
      this.early.push(candidate);
      return;
    }
    const lines = [
      `a=ice-ufrag:${candidate.usernameFragment ?? ""}`,
      `m=video 9 UDP/TLS/RTP/SAVPF 0`,
      `a=mid:${candidate.sdpMid ?? "0"}`,
      `a=${candidate.candidate}`,
    ];
    const body = `${lines.join("\r\n")}\r\n`;
    fetch(this.location, {
      method: "PATCH",
      headers: { ...this.session.httpHeaders, "Content-Type": FRAGMENT },
      body,
    }).catch((error: Error) => console.debug("a candidate was not taken:", error.message));
  }

  private play(track: MediaStreamTrack): void {
    if (typeof MediaStreamTrackProcessor === "function") {
      this.read(new MediaStreamTrackProcessor({ track }).readable.getReader()).catch((error: Error) =>
        this.fail(error),
      );
      return;
    }
    const { video } = this;
    video.srcObject = new MediaStream([track]);
    video.play().catch((error: Error) => this.fail(error));
    const shown = (_: number, { rtpTimestamp }: VideoFrameCallbackMetadata) => {
      if (this.over) return;
      this.show(video, video.videoWidth, video.videoHeight, rtpTimestamp);
      video.requestVideoFrameCallback(shown);
    };
    video.requestVideoFrameCallback(shown);
  }

  /** Pictures as they are decoded; a player would hold each until its time by its own reckoning. */
  private async read(frames: ReadableStreamDefaultReader<VideoFrame>): Promise<void> {
    for (;;) {
      const { value: frame, done } = await frames.read();
      if (done) throw new Error("the video has ended");
      if (this.over) {
        frame.close();
        await frames.cancel();
        return;
      }
      // Chromium tells it for frames of a connection; TypeScript does not know.
      const { rtpTimestamp } = (frame as FrameOfConnection).metadata?.() ?? {};
      this.show(frame, frame.displayWidth, frame.displayHeight, rtpTimestamp);
      frame.close();
    }
  }

  private show(picture: CanvasImageSource, width: number, height: number, rtp?: number): void {
    clearTimeout(this.patience);
    this.onPicture(picture, width, height, rtp === undefined ? Number.NaN : this.mediaTime(rtp));
  }

  /** The seconds of an RTP timestamp, which begins anew after 2^32 ticks. */
  private mediaTime(rtp: number): number {
    if (rtp < this.lastRtp - RTP_RANGE / 2) this.rtpRounds++;
    this.lastRtp = rtp;
    return (this.rtpRounds * RTP_RANGE + rtp) / RTP_RATE;
  }

  private changed(): void {
    const { connectionState } = this.connection;
    const end = () => this.fail(new Error(`the connection for video is ${connectionState}`));
    if (connectionState === "connected" || connectionState === "disconnected") clearTimeout(this.patience);
    // A short outage ends by itself, without another offer.
    if (connectionState === "disconnected") this.patience = setTimeout(end, CONNECT);
    if (connectionState === "failed" || connectionState === "closed") end();
  }
}
