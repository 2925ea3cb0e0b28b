/** Definitions of types, as rosapi tells them, and values that fit them. */

/** One field of a message. */
export interface Field {
  name: string;
  /** `float64`, `string`, or the name of another message. */
  type: string;
  /** null for one value, 0 for any number of them, else how many. */
  length: number | null;
}

export interface Constant {
  name: string;
  value: number | string | boolean;
}

/** A message's fields and constants. */
export interface TypeDefinition {
  type: string;
  fields: Field[];
  constants: Constant[];
}

/** One definition as rosapi sends it. */
export interface RosapiTypeDef {
  type: string;
  fieldnames: string[];
  fieldtypes: string[];
  fieldarraylen: number[];
  constnames?: string[];
  constvalues?: string[];
}

/** The definitions of a message and of all that it contains; the first is the message itself. */
export class Definitions {
  private readonly byName = new Map<string, TypeDefinition>();
  readonly root: TypeDefinition;

  /** Throws where the list is empty. */
  constructor(typedefs: RosapiTypeDef[]) {
    for (const each of typedefs) {
      this.byName.set(bareName(each.type), {
        type: each.type,
        fields: each.fieldnames.map((name, index) => {
          const length = each.fieldarraylen[index] ?? -1;
          return { name, type: each.fieldtypes[index] ?? "string", length: length < 0 ? null : length };
        }),
        constants: (each.constnames ?? []).map((name, index) => ({
          name,
          value: constantValue(each.constvalues?.[index] ?? ""),
        })),
      });
    }
    const root = typedefs[0] && this.byName.get(bareName(typedefs[0].type));
    if (!root) throw new Error("the robot does not know this type");
    this.root = root;
  }

  /** The definition of a message type that occurs in this one; undefined for plain values. */
  find(type: string): TypeDefinition | undefined {
    return this.byName.get(bareName(type));
  }

  /** A message of zeros, empty strings and empty lists. */
  empty(definition: TypeDefinition = this.root, depth = 0): Record<string, unknown> {
    const message: Record<string, unknown> = {};
    if (depth < 32)
      for (const field of definition.fields) message[field.name] = this.emptyField(field, depth);
    return message;
  }

  /** The empty value of a field. */
  emptyField(field: Field, depth = 0): unknown {
    if (field.length === null) return this.emptyItem(field, depth);
    return Array.from({ length: field.length }, () => this.emptyItem(field, depth));
  }

  /** The empty value of one item of a field. */
  emptyItem(field: Field, depth = 0): unknown {
    const nested = this.find(field.type);
    if (nested) return this.empty(nested, depth + 1);
    if (isBoolean(field.type)) return false;
    if (isNumber(field.type)) return 0;
    if (field.type === "time" || field.type === "duration") return { secs: 0, nsecs: 0 };
    return "";
  }
}

/** `pkg/msg/Name` and `pkg/Name` → `pkg/Name`. */
function bareName(type: string): string {
  return type.replace(/\/(msg|srv|action)\//, "/");
}

function constantValue(text: string): number | string | boolean {
  if (text === "True" || text === "true") return true;
  if (text === "False" || text === "false") return false;
  return text.trim() !== "" && Number.isFinite(Number(text)) ? Number(text) : text;
}

const INTEGERS: Record<string, [least: number | bigint, most: number | bigint]> = {
  int8: [-128, 127],
  uint8: [0, 255],
  byte: [0, 255],
  octet: [0, 255],
  char: [0, 255],
  int16: [-32768, 32767],
  uint16: [0, 65535],
  int32: [-2147483648, 2147483647],
  uint32: [0, 4294967295],
  int64: [-(2n ** 63n), 2n ** 63n - 1n],
  uint64: [0n, 2n ** 64n - 1n],
};
const FLOATS = new Set(["float", "double", "float32", "float64"]);

/** The range of an integer type; undefined for other types. */
export function integerRange(type: string): [least: number | bigint, most: number | bigint] | undefined {
  return INTEGERS[type];
}

/** Return true if values of a type are numbers. */
export function isNumber(type: string): boolean {
  return type in INTEGERS || FLOATS.has(type);
}

/** Return true if values of a type are true or false. */
export function isBoolean(type: string): boolean {
  return type === "bool" || type === "boolean";
}

/**
 * The constants that name the values of an integer field: those whose names begin with the field's name, else all
 * of the type where the message has one integer field only.
 */
export function namedValues(definition: TypeDefinition, field: Field): Constant[] {
  const numbers = definition.constants.filter((each) => typeof each.value === "number");
  if (!(field.type in INTEGERS) || field.length !== null || numbers.length === 0) return [];
  const own = numbers.filter((each) => each.name.toLowerCase().startsWith(`${field.name.toLowerCase()}_`));
  if (own.length) return own;
  const integers = definition.fields.filter((each) => each.type in INTEGERS && each.length === null);
  return integers.length === 1 ? numbers : [];
}

/** Error of a text as a value of a plain type; null if it is valid. */
export function valueError(type: string, text: string): "number" | "integer" | "range" | null {
  if (!isNumber(type)) return null;
  const value = Number(text);
  if (text.trim() === "" || !Number.isFinite(value)) return "number";
  const range = INTEGERS[type];
  if (!range) return null;
  if (!Number.isInteger(value)) return "integer";
  const exact = numberOf(text);
  return exact < range[0] || exact > range[1] ? "range" : null;
}

/** The number that a text names; as a bigint if a number would lose its last digits. */
export function numberOf(text: string): number | bigint {
  const value = Number(text);
  const isExact = Number.isSafeInteger(value) || !/^\s*[+-]?\d+\s*$/.test(text);
  return isExact ? value : BigInt(text.trim().replace(/^\+/, ""));
}
