/** Attributes of elements as properties: each has a kind, which reads and writes its text. */

import { type Signal, signal } from "@preact/signals";

export interface AttributeKind<Value> {
  /** The value where the attribute is not there. */
  initial: Value;
  /** Parsed value of a text; undefined if it is invalid. */
  read(text: string): Value | undefined;
  /** The text of a value; null for the attribute not to be there. */
  write(value: Value): string | null;
}

export function text(initial = ""): AttributeKind<string> {
  return {
    initial,
    read: (written) => written,
    write: (value) => (value === initial ? null : String(value)),
  };
}

/** A number; one outside of the range counts as the nearest that is in it. */
export function number(initial: number, least: number, most: number): AttributeKind<number> {
  return {
    initial,
    read: (written) => {
      const value = Number(written);
      if (written.trim() === "" || Number.isNaN(value)) return undefined;
      return Math.min(Math.max(value, least), most);
    },
    write: (value) => (value === initial ? null : String(value)),
  };
}

/** Boolean attribute. */
export function flag(): AttributeKind<boolean> {
  return { initial: false, read: (written) => written !== "false", write: (value) => (value ? "" : null) };
}

/** One of a few words, of which the first is that of an element without the attribute. */
export function choice<Word extends string>(...words: readonly [Word, ...Word[]]): AttributeKind<Word> {
  return {
    initial: words[0],
    read: (written) => words.find((word) => word === written),
    write: (value) => (value === words[0] ? null : value),
  };
}

// biome-ignore lint/suspicious/noExplicitAny: each kind reads and writes its own type.
export type Attributes = Record<string, AttributeKind<any>>;

export type ValueOf<Kind> = Kind extends AttributeKind<infer Value> ? Value : never;

/** The properties of attributes, `max-linear` as `maxLinear`. */
export type PropertiesOf<Kinds extends Attributes> = {
  [Name in keyof Kinds]: ValueOf<Kinds[Name]>;
};

/** `maxLinear` → `max-linear`. */
export function attributeName(property: string): string {
  return property.replace(/[A-Z]/g, (letter) => `-${letter.toLowerCase()}`);
}

/** The values of an element's attributes, as signals by property. */
export class AttributeValues {
  private readonly signals = new Map<string, Signal<unknown>>();
  private readonly kinds: Attributes;
  private readonly properties = new Map<string, string>();

  constructor(
    private readonly element: HTMLElement,
    kinds: Attributes,
  ) {
    this.kinds = kinds;
    for (const [property, kind] of Object.entries(kinds)) {
      this.signals.set(property, signal(kind.initial));
      this.properties.set(attributeName(property), property);
    }
  }

  /** The signal of a property. */
  of(property: string): Signal<unknown> {
    const found = this.signals.get(property);
    if (!found) throw new Error(`${this.element.localName} has no property ${property}`);
    return found;
  }

  /** An attribute has been written. */
  changed(attribute: string, written: string | null): void {
    const property = this.properties.get(attribute);
    const kind = property === undefined ? undefined : this.kinds[property];
    if (property === undefined || kind === undefined) return;
    const value = written === null ? kind.initial : (kind.read(written) ?? kind.initial);
    this.of(property).value = value;
  }

  /** A property has been set: its attribute says so, too. */
  set(property: string, value: unknown): void {
    const kind = this.kinds[property];
    if (!kind) return;
    const name = attributeName(property);
    const given = value === undefined || value === null ? kind.initial : value;
    const known = typeof given === "string" ? kind.read(given) : kind.read(String(given));
    const written = kind.write(known ?? kind.initial);
    if (written === null) this.element.removeAttribute(name);
    else this.element.setAttribute(name, written);
  }
}
