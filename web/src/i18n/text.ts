/** Texts of the page by their keys. */

import { en, type TextKey } from "./en";

export type { TextKey };
export type Translation = Partial<Record<TextKey, string>>;

let table: Translation = en;

/** Take another language's table. */
export function translate(translation: Translation): void {
  table = { ...en, ...translation };
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

/** Speak a language from now on. */
export async function speak(language: string): Promise<void> {
  translate((await LANGUAGES[language]?.()) ?? {});
}

/** The text of a key with its `{places}` filled in. */
export function t(key: TextKey, values: Record<string, string | number> = {}): string {
  return (table[key] ?? en[key]).replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ""));
}
