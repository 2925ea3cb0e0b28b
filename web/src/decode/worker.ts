/**
 * The worker that holds the WebSocket: it decodes what arrives, so that the page's thread is given objects and
 * typed arrays.
 */

import { setBound, tooLarge } from "./bound";
import { decodeCbor } from "./cbor";
import { decodeFurther, type Envelope, forget, receive, say, taken } from "./delivery";
import { type Answering, GIVE_UP, Liveness, SILENT } from "./liveness";
import type { ToWorker } from "./protocol";

interface Connection {
  socket: WebSocket;
  /** Null until the connection is open. */
  liveness: Liveness | null;
  answering: Answering;
}

/** Milliseconds between two looks at whether the robot answers. */
const LOOK = 100;
/** Bytes that wait in the browser above which commands and samples are dropped: they would arrive late. */
const MOST_WAITING = 64 * 1024;

const sockets = new Map<number, Connection>();

self.onmessage = ({ data }: MessageEvent<ToWorker>) => {
  switch (data.kind) {
    case "open":
      open(data.socket, data.url, data.protocols);
      break;
    case "send":
      send(data.socket, data.text, data.command);
      break;
    case "close":
      sockets.get(data.socket)?.socket.close();
      break;
    case "bound":
      setBound(data.bytes, data.unbounded);
      break;
    case "decodings":
      decodeFurther(data.decodings);
      break;
    case "taken":
      taken(data.topic);
      break;
  }
};

function open(number: number, url: string, protocols: string[]): void {
  let socket: WebSocket;
  try {
    socket = new WebSocket(url, protocols);
  } catch (error) {
    say({ kind: "close", socket: number, code: 1006, reason: String(error) });
    return;
  }
  socket.binaryType = "arraybuffer";
  const connection: Connection = {
    socket,
    liveness: null,
    answering: { silence: 0, clockOffset: 0, trip: 0 },
  };
  sockets.set(number, connection);
  socket.onopen = () => {
    connection.liveness = new Liveness(performance.now());
    say({ kind: "open", socket: number });
  };
  socket.onclose = ({ code, reason }) => {
    sockets.delete(number);
    forget();
    say({ kind: "close", socket: number, code, reason });
  };
  socket.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => {
    try {
      const refused = tooLarge(data);
      if (refused !== null) {
        connection.liveness?.noteTraffic(performance.now());
        say({
          kind: "refused",
          topic: refused,
          bytes: typeof data === "string" ? data.length : data.byteLength,
        });
        return;
      }
      const message = (
        typeof data === "string" ? JSON.parse(data) : decodeCbor(new Uint8Array(data))
      ) as Envelope;
      if (typeof message?.op !== "string") throw new Error("a message without `op`");
      if (connection.liveness?.hear(message as { op: string }, performance.now(), Date.now())) {
        look(number, connection);
        return;
      }
      receive(number, message, typeof data === "string" ? data.length : data.byteLength);
    } catch (error) {
      say({ kind: "error", socket: number, text: `a message cannot be read: ${(error as Error).message}` });
    }
  };
}

function send(number: number, text: string, command?: number): void {
  const connection = sockets.get(number);
  if (!connection) return;
  if (command !== undefined) {
    const { socket, liveness } = connection;
    const isLate =
      Date.now() - command > SILENT ||
      socket.bufferedAmount > MOST_WAITING ||
      (liveness?.answering(performance.now()).silence ?? 0) > 0;
    if (isLate) return;
  }
  connection.socket.send(text);
}

/** Send a beat if one is due, and tell the page how the robot answers. */
function look(number: number, connection: Connection): void {
  const { socket, liveness, answering: before } = connection;
  if (!liveness || socket.readyState !== WebSocket.OPEN) return;
  const now = performance.now();
  const beat = liveness.beat(now);
  if (beat) socket.send(beat);
  const answering = liveness.answering(now);
  connection.answering = answering;
  // The clock is told to the millisecond: the page has no use for more.
  const isNews =
    answering.silence !== before.silence ||
    Math.abs(answering.clockOffset - before.clockOffset) >= 1 ||
    Math.abs(answering.trip - before.trip) >= 1;
  if (isNews) say({ kind: "answering", socket: number, ...answering });
  if (!liveness.isDead(now)) return;
  // A lost network: the system would retry ever less often, and take as long again to notice that it is back.
  socket.onclose = socket.onmessage = null;
  socket.close();
  sockets.delete(number);
  forget();
  say({ kind: "close", socket: number, code: 1006, reason: `no answer for ${GIVE_UP / 1000} s` });
}

setInterval(() => {
  for (const [number, connection] of sockets) look(number, connection);
}, LOOK);
