/** Texts of the page by their keys. */

import { en, type TextKey } from "./en";

export type { TextKey };
export type Translation = Partial<Record<TextKey, string>>;

let table: Translation = en;

/** Take another language's table. */
export function translate(translation: Translation): void {
  table = { ...en, ...translation };
}

/** The text of a key with its `{places}` filled in. */
export function t(key: TextKey, values: Record<string, string | number> = {}): string {
  return (table[key] ?? en[key]).replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ""));
}
