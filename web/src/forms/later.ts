/** Parts of the page that are loaded when they are wanted. */

import { useSignal } from "@preact/signals";
import { type Inputs, useEffect } from "preact/hooks";
import { useTexts } from "../i18n/context";
import type { Texts } from "../i18n/text";

/** Milliseconds before a part that failed to load is asked for again, the first time and the second. */
const AGAIN = [1000, 4000];
/** Milliseconds after which a part is said to be late; it is waited for all the same. */
const LATE = 15_000;

/** Reason for a missing part: it is late, does not load, or failed at its start. */
export type Trouble = { kind: "late" | "missing" | "failed"; reason: string };

/**
 * Load a part of the page and begin with it: it comes in the end, or it is told what keeps it away.
 *
 * Some browsers remember that a module did not load, and do not ask for it again before the page is loaded again (the
 * module map of WHATWG's HTML standard, 8.1.4); others ask again.
 *
 * @param load imports it
 * @param begin what it is wanted for; may return what ends that, and throw
 * @param tell told of trouble, and with `null` that there is none any more
 * @returns what ends all of it
 */
export function loadLater<Part>(
  load: () => Promise<Part>,
  begin: (part: Part) => (() => void) | undefined,
  tell: (trouble: Trouble | null) => void,
): () => void {
  let ended = false;
  let timer: ReturnType<typeof setTimeout> | undefined;
  let end: (() => void) | undefined;
  const come = (part: Part) => {
    clearTimeout(timer);
    if (ended) return;
    tell(null);
    try {
      end = begin(part);
    } catch (error) {
      tell({ kind: "failed", reason: (error as Error).message });
    }
  };
  const attempt = (failures: number) => {
    timer = setTimeout(() => tell({ kind: "late", reason: "" }), LATE);
    load().then(come, (error: Error) => {
      clearTimeout(timer);
      if (ended) return;
      tell({ kind: "missing", reason: error.message });
      const wait = AGAIN[failures];
      if (wait !== undefined) timer = setTimeout(() => attempt(failures + 1), wait);
    });
  };
  attempt(0);
  return () => {
    ended = true;
    clearTimeout(timer);
    end?.();
  };
}

/** {@link loadLater} for as long as a component is there and the inputs stay; returns what is wrong, in words. */
export function useLater<Part>(
  load: () => Promise<Part>,
  begin: (part: Part) => (() => void) | undefined,
  inputs: Inputs,
): string {
  const t = useTexts();
  const trouble = useSignal<Trouble | null>(null);
  useEffect(
    () =>
      loadLater(load, begin, (told) => {
        trouble.value = told;
      }),
    inputs,
  );
  return inWords(trouble.value, t);
}

/** Reason for a missing part as text; empty if there is none. */
export function inWords(trouble: Trouble | null, t: Texts): string {
  if (!trouble) return "";
  const { kind, reason } = trouble;
  return t(kind === "failed" ? "panel.failed" : `part.${kind}`, { reason });
}
