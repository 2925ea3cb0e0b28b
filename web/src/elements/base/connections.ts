/** The connections of a page's elements: one for each robot, however many elements show it. */

import { RobotSession } from "../../robot/session";
import { Stop } from "../../robot/stop";
import type { WorkerPort } from "../../robot/transport";

/** A robot, and what keeps its controls of this page from working. */
export interface Robot {
  session: RobotSession;
  stop: Stop;
}

/** The text of the decoding worker. */
declare const DECODE_WORKER_SOURCE: string;

interface Kept extends Robot {
  users: number;
  closing: ReturnType<typeof setTimeout> | undefined;
}

/** Milliseconds that a connection outlives its last element, which may only be on its way to another place. */
const OUTLIVES = 1000;
const TOKEN = "rwt-token ";

const kept = new Map<string, Kept>();

/**
 * The worker is part of this script, since a page may only start workers of its own origin, which is another one.
 * Without permission for that (the directive `worker-src` of its policy) a page has no elements.
 */
function startWorker(): WorkerPort {
  const url = URL.createObjectURL(new Blob([DECODE_WORKER_SOURCE], { type: "text/javascript" }));
  try {
    return new Worker(url) as unknown as WorkerPort;
  } finally {
    URL.revokeObjectURL(url);
  }
}

/** Where tokens are kept: until the tab is closed, and for this page's origin alone. */
function storedToken(url: string): string {
  try {
    return sessionStorage.getItem(TOKEN + url) ?? "";
  } catch {
    return ""; // A frame without an origin has no storage.
  }
}

/** The robot at a WebSocket URL, until `giveBack` is called. */
export function borrowRobot(url: string): { robot: Robot; giveBack: () => void } {
  let found = kept.get(url);
  if (!found) {
    const session = new RobotSession({ url, token: storedToken(url), worker: startWorker });
    found = { session, stop: new Stop(session), users: 0, closing: undefined };
    kept.set(url, found);
  }
  const mine = found;
  mine.users++;
  clearTimeout(mine.closing);
  let held = true;
  const giveBack = () => {
    if (!held) return;
    held = false;
    if (--mine.users > 0) return;
    mine.closing = setTimeout(() => {
      kept.delete(url);
      mine.session.close();
    }, OUTLIVES);
  };
  return { robot: mine, giveBack };
}

/** Show a robot a token, which is kept for this tab. */
export function showToken(session: RobotSession, token: string): void {
  try {
    sessionStorage.setItem(TOKEN + session.url, token);
  } catch {
    // A frame without an origin has no storage: the token is asked for again when the frame is loaded again.
  }
  session.authenticate(token);
}

/** The robot that this script came from; else the one that the page came from. */
export function homeRobot(): string {
  const isServed = /\/web\/widgets[^/]*\.js$/.test(new URL(import.meta.url).pathname);
  const base = isServed ? new URL("..", import.meta.url) : new URL("/", location.href);
  base.protocol = base.protocol === "https:" ? "wss:" : "ws:";
  return base.href;
}
