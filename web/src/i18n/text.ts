/** Texts of the page by their keys. */

import { en, type TextKey } from "./en";

export type { TextKey };
export type Translation = Partial<Record<TextKey, string>>;

/** Gives the text of a key with its `{places}` filled in. */
export type Texts = (key: TextKey, values?: Record<string, string | number>) => string;

/** The text of a key in English. */
export const english = textsIn(en);

let spoken = english;

/** The text of a key in the language that the page speaks. */
export const t: Texts = (key, values) => spoken(key, values);

/** Take another language's table. */
export function translate(translation: Translation): void {
  spoken = textsIn(translation);
}

/** Languages besides English by their codes (RFC 5646); each is loaded when it is wanted. */
const LANGUAGES: Record<string, () => Promise<Translation>> = {
  de: () => import("./de").then(({ de }) => de),
};

/** Which language a person who prefers `languages`, the first most, is shown: the first that there is. */
export function chooseLanguage(languages: readonly string[]): string {
  const codes = languages.map((each) => each.toLowerCase().split("-")[0] as string);
  return codes.find((code) => code === "en" || Object.hasOwn(LANGUAGES, code)) ?? "en";
}

/** Milliseconds that a page without words waits for those of its reader's language. */
const PATIENCE = 5000;

/** Speak a language from now on; English where its texts do not come. Returns which it is. */
export async function speak(language: string): Promise<string> {
  const late = new Promise<null>((tell) => setTimeout(tell, PATIENCE, null));
  const texts = await Promise.race([textsOf(language).catch(() => null), late]);
  spoken = texts ?? english;
  return texts ? language : "en";
}

/** The texts of a language; English where there is no table of it. */
export async function textsOf(language: string): Promise<Texts> {
  const translation = await LANGUAGES[language]?.();
  return translation ? textsIn(translation) : english;
}

/** The texts of a table; those that it lacks are English. */
function textsIn(table: Translation): Texts {
  return (key, values = {}) =>
    (table[key] ?? en[key]).replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ""));
}
