/** Messages as ROS serialises them, CDR or ROS 1's own format, read by the definitions of their types. */

/** One field; `length` is null for one value, -1 for any number of them, else how many. */
interface Field {
  name: string;
  type: string;
  length: number | null;
}

/** Fields of types by their names, as `std_msgs/Header`. */
export type RosTypes = ReadonlyMap<string, readonly Field[]>;

type Read = (view: DataView, at: number, little: boolean) => number | boolean;
type NumberArray = {
  from(values: ArrayLike<number>): ArrayBufferView;
  new (bytes: ArrayBuffer): ArrayBufferView;
};

const OCTET: [size: number, read: Read, array: NumberArray] = [
  1,
  (view, at) => view.getUint8(at),
  Uint8Array,
];
/** Plain types: size, how one value is read, and the array of many; integers beyond 2^53 lose their last digits. */
const PLAIN: Record<string, [size: number, read: Read, array?: NumberArray]> = {
  bool: [1, (view, at) => view.getUint8(at) !== 0],
  byte: OCTET,
  char: OCTET,
  uint8: OCTET,
  int8: [1, (view, at) => view.getInt8(at), Int8Array],
  uint16: [2, (view, at, little) => view.getUint16(at, little), Uint16Array],
  int16: [2, (view, at, little) => view.getInt16(at, little), Int16Array],
  uint32: [4, (view, at, little) => view.getUint32(at, little), Uint32Array],
  int32: [4, (view, at, little) => view.getInt32(at, little), Int32Array],
  uint64: [8, (view, at, little) => Number(view.getBigUint64(at, little))],
  int64: [8, (view, at, little) => Number(view.getBigInt64(at, little))],
  float32: [4, (view, at, little) => view.getFloat32(at, little), Float32Array],
  float64: [8, (view, at, little) => view.getFloat64(at, little), Float64Array],
};
const one = (name: string, type: string): Field => ({ name, type, length: null });
/** Types that definitions may refer to without containing them. */
const KNOWN: RosTypes = new Map([
  ["time", [one("secs", "uint32"), one("nsecs", "uint32")]],
  ["duration", [one("secs", "int32"), one("nsecs", "int32")]],
  ["builtin_interfaces/Time", [one("sec", "int32"), one("nanosec", "uint32")]],
  ["builtin_interfaces/Duration", [one("sec", "int32"), one("nanosec", "uint32")]],
]);
/** Limits on the work for one message, whatever its definition says. */
const MOST_DEPTH = 64;
const MOST_VALUES = 4_000_000;
/** Native order of bytes of typed arrays. */
const IS_LITTLE = new Uint8Array(Uint16Array.of(1).buffer)[0] === 1;

const utf8 = new TextDecoder();

/** `pkg/msg/Name` → `pkg/Name`. */
const bare = (type: string) => type.replace("/msg/", "/");

/**
 * The types in the text of a definition, in which those that it uses follow behind lines of `=`.
 *
 * @param root name of the first type
 */
export function rosTypes(root: string, text: string): RosTypes {
  const found = new Map(KNOWN);
  for (const part of text.split(/^={3,}\s*$/m)) {
    const name = bare(/^\s*MSG:\s*(\S+)/.exec(part)?.[1] ?? root);
    const fields: Field[] = [];
    for (const line of part.split("\n")) {
      const parsed = /^\s*([\w/]+)(?:<=\d+)?(\[(<=)?(\d*)\])?\s+([A-Za-z]\w*)\s*(=?)/.exec(line);
      if (!parsed || parsed[6]) continue; // Nothing, or a constant.
      const [, type = "", list, atMost, count] = parsed;
      const isFull = type.includes("/") || type === "string" || type in PLAIN || KNOWN.has(type);
      const other = type === "Header" ? "std_msgs/Header" : `${name.split("/")[0]}/${type}`;
      const length = !list ? null : count && !atMost ? Number(count) : -1;
      fields.push({ name: parsed[5] as string, type: isFull ? bare(type) : other, length });
    }
    found.set(name, fields);
  }
  return found;
}

/**
 * A message from its bytes.
 *
 * @param root name of its type
 * @param isCdr true for CDR, false for the format of ROS 1
 * @param typed true if lists of numbers are wanted as typed arrays; those of octets always are
 * @throws Error the bytes do not fit the definition
 */
export function readMessage(
  types: RosTypes,
  root: string,
  bytes: Uint8Array,
  isCdr: boolean,
  typed: boolean,
) {
  return new Reader(types, bytes, isCdr, typed).fields(bare(root), 0);
}

class Reader {
  private readonly view: DataView;
  private readonly little: boolean;
  /** Greatest alignment; that of ROS 1 is none. */
  private readonly most: number;
  private at = 0;
  private count = 0;

  constructor(
    private readonly types: RosTypes,
    private readonly bytes: Uint8Array,
    private readonly isCdr: boolean,
    private readonly typed: boolean,
  ) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const representation = isCdr ? this.view.getUint8(1) : 1;
    if (![0, 1, 6, 7].includes(representation)) throw new Error(`CDR of kind ${representation}`);
    this.little = (representation & 1) === 1;
    this.most = !isCdr ? 1 : representation > 1 ? 4 : 8;
    if (isCdr) this.at = 4;
  }

  /** Place of so many bytes that are read next, at their alignment. */
  private take(size: number, alignment = 1): number {
    const step = Math.min(alignment, this.most);
    // Counted from behind the four octets in front of CDR.
    const at = this.at + ((step - ((this.at - 4) % step)) % step);
    if (at + size > this.bytes.length) throw new Error("the message is shorter than its type");
    this.at = at + size;
    return at;
  }

  fields(type: string, depth: number): Record<string, unknown> {
    const fields = this.types.get(type);
    if (!fields) throw new Error(`the file has no definition of ${type}`);
    if (depth > MOST_DEPTH) throw new Error("nested too deeply");
    const message: Record<string, unknown> = {};
    for (const field of fields) {
      message[field.name] =
        field.length === null ? this.value(field.type, depth) : this.list(field.type, field.length, depth);
    }
    // IDL has no empty structures: they have one octet.
    if (this.isCdr && !fields.length) this.take(1);
    return message;
  }

  private size(): number {
    return this.view.getUint32(this.take(4, 4), this.little);
  }

  private value(type: string, depth: number): unknown {
    if (++this.count > MOST_VALUES) throw new Error(`more than ${MOST_VALUES} values`);
    const plain = PLAIN[type];
    if (plain) return plain[1](this.view, this.take(plain[0], plain[0]), this.little);
    if (type !== "string") return this.fields(type, depth + 1);
    const size = this.size();
    const at = this.take(size);
    return utf8.decode(this.bytes.subarray(at, at + size - (this.isCdr && size ? 1 : 0)));
  }

  private list(type: string, length: number, depth: number): unknown {
    const count = length < 0 ? this.size() : length;
    const plain = PLAIN[type];
    if (!plain?.[2]) {
      // Each has one octet at least, but for empty ones of ROS 1, of which nobody makes lists.
      if (count > this.bytes.length - this.at) throw new Error("a list is longer than the message");
      return Array.from({ length: count }, () => this.value(type, depth));
    }
    const [size, read, array] = plain;
    if (!count) return this.typed || size === 1 ? array.from([]) : [];
    const at = this.take(count * size, size);
    // A copy of its own, which can be handed on.
    if (this.typed && this.little === IS_LITTLE)
      return new array(this.bytes.slice(at, at + count * size).buffer);
    const values = Array.from({ length: count }, (_, place) =>
      read(this.view, at + place * size, this.little),
    );
    return this.typed || (size === 1 && type !== "int8") ? array.from(values as number[]) : values;
  }
}
