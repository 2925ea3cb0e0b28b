/** In which language an element speaks: that of the part of the page that it is in. */

import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { chooseLanguage, english, type Texts, textsOf } from "../../i18n/text";

/** Counts up when an attribute `lang` of the page changes. */
const changes = signal(0);
let isWatched = false;

/** An element's own attribute `lang` was written; the page's are watched. */
export function languageChanged(): void {
  changes.value++;
}

/**
 * The language of the nearest attribute `lang` of an element or what it is in, through shadows; where there is none, the
 * first that the reader prefers.
 */
export function languageOf(element: Element): string {
  for (let at: Node | null = element; at; at = at instanceof ShadowRoot ? at.host : at.parentNode) {
    const written = at instanceof Element ? at.getAttribute("lang") : null;
    if (written) return chooseLanguage([written]);
  }
  return chooseLanguage(navigator.languages);
}

/** The texts of an element's language; null until they have come. */
export function useLanguage(element: Element): { language: string; texts: Texts } | null {
  if (!isWatched) watch();
  changes.value;
  const wanted = languageOf(element);
  const spoken = useSignal(wanted === "en" ? { language: wanted, texts: english } : null);
  useEffect(() => {
    let ended = false;
    const speak = (language: string, texts: Texts) => {
      if (!ended) spoken.value = { language, texts };
    };
    textsOf(wanted).then(
      (texts) => speak(wanted, texts),
      () => speak("en", english), // Rather in English than not at all.
    );
    return () => {
      ended = true;
    };
  }, [wanted, spoken]);
  return spoken.value;
}

function watch(): void {
  isWatched = true;
  const watching = new MutationObserver(languageChanged);
  watching.observe(document, { attributes: true, attributeFilter: ["lang"], subtree: true });
}
