/** Request to the robot, until it has answered. */

import { effect, untracked } from "@preact/signals-core";
import type { RobotSession } from "./session";

/** Milliseconds after a failure before it is asked again; twice as many after each that follows, to a bound. */
const AGAIN = 3000;
const MOST = 30_000;

/**
 * Ask with each connection, from one that there is already on, and after a failure again, until there is an answer.
 *
 * @param ask one attempt
 * @param take given the answer
 * @param tell told why an attempt failed, and with an empty text that one did not
 * @returns what ends it; nothing is told from then on
 */
export function keepAsking<Answer>(
  session: RobotSession,
  ask: () => Promise<Answer>,
  take: (answer: Answer) => void,
  tell: (problem: string) => void,
): () => void {
  return effect(() => {
    if (session.state.value !== "open") return undefined;
    let ended = false;
    let timer: ReturnType<typeof setTimeout> | undefined;
    const attempt = (wait: number) => {
      ask().then(
        (answer) => {
          if (ended) return;
          tell("");
          take(answer);
        },
        (error: Error) => {
          if (ended) return;
          tell(error.message);
          timer = setTimeout(() => attempt(Math.min(wait * 2, MOST)), wait);
        },
      );
    };
    untracked(() => attempt(AGAIN));
    return () => {
      ended = true;
      clearTimeout(timer);
    };
  });
}
