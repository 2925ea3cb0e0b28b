/** Screens that show one panel at a time. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

/** Narrow or low screens, such as phones. */
const NARROW = "(max-width: 760px), (max-height: 500px)";

/** True while the screen shows one panel at a time. */
export function useNarrow(): boolean {
  const narrow = useSignal(matchMedia(NARROW).matches);
  useEffect(() => {
    const query = matchMedia(NARROW);
    const change = () => {
      narrow.value = query.matches;
    };
    query.addEventListener("change", change);
    return () => query.removeEventListener("change", change);
  }, [narrow]);
  return narrow.value;
}
