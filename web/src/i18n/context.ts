/** The language of a part of a page: that of the page itself, unless an element for other pages has one of its own. */

import { createContext } from "preact";
import { useContext } from "preact/hooks";
import { type Texts, t } from "./text";

export const Language = createContext<Texts>(t);

/** The texts in the language of where a component is. */
export function useTexts(): Texts {
  return useContext(Language);
}
