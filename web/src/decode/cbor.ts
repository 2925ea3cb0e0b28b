/**
 * CBOR (RFC 8949) with the typed arrays of RFC 8746, as rosbridge servers send it. Numbers beyond 2^53 lose their
 * last digits, as in JSON. Strings of bytes are copied out of the message, so that they can be handed on.
 */

const utf8 = new TextDecoder();

class CborError extends Error {}

type Reader = (bytes: ArrayBuffer) => unknown;

const TYPED_ARRAYS: Record<number, Reader> = {
  64: (bytes) => new Uint8Array(bytes),
  69: (bytes) => new Uint16Array(bytes),
  70: (bytes) => new Uint32Array(bytes),
  71: (bytes) => Float64Array.from(new BigUint64Array(bytes), Number),
  72: (bytes) => new Int8Array(bytes),
  77: (bytes) => new Int16Array(bytes),
  78: (bytes) => new Int32Array(bytes),
  79: (bytes) => Float64Array.from(new BigInt64Array(bytes), Number),
  85: (bytes) => new Float32Array(bytes),
  86: (bytes) => new Float64Array(bytes),
};

class Decoder {
  private at = 0;
  /** Items of all arrays so far, of which each takes a byte: arrays in arrays could claim the same bytes again. */
  private claimed = 0;
  private readonly view: DataView;

  constructor(private readonly bytes: Uint8Array) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  whole(): unknown {
    const value = this.value(0);
    if (this.at !== this.bytes.length) throw new CborError("bytes follow the message");
    return value;
  }

  /** The members of a map before the one of a name. */
  before(name: string): Record<string, unknown> {
    const object: Record<string, unknown> = {};
    const head = this.view.getUint8(this.at++);
    if (head >> 5 !== 5 || (head & 31) === 31) return object;
    for (let left = this.argument(head & 31); left > 0; left--) {
      const start = this.at;
      if (this.value(1) === name) break;
      this.at = start;
      this.member(object, 0);
    }
    return object;
  }

  private value(depth: number): unknown {
    if (depth > 128) throw new CborError("nested too deeply");
    const head = this.view.getUint8(this.at++);
    const major = head >> 5;
    const info = head & 31;
    if (major === 7) return this.simple(info);
    if (info === 31) return this.indefinite(major, depth);
    const size = this.argument(info);
    switch (major) {
      case 0:
        return size;
      case 1:
        return -1 - size;
      case 2:
        return this.take(size);
      case 3:
        return utf8.decode(this.take(size));
      case 4: {
        this.claimed += size;
        if (this.claimed > this.bytes.length) throw new CborError("an array is longer than the message");
        const items = new Array<unknown>(size);
        for (let index = 0; index < size; index++) items[index] = this.value(depth + 1);
        return items;
      }
      case 5: {
        const object: Record<string, unknown> = {};
        for (let index = 0; index < size; index++) this.member(object, depth);
        return object;
      }
      default:
        return this.tagged(size, depth);
    }
  }

  private member(object: Record<string, unknown>, depth: number): void {
    const key = String(this.value(depth + 1));
    const value = this.value(depth + 1);
    // A member of that name would replace the object's prototype.
    if (key !== "__proto__") object[key] = value;
  }

  private indefinite(major: number, depth: number): unknown {
    const until = (each: () => void) => {
      while (this.view.getUint8(this.at) !== 0xff) each();
      this.at++;
    };
    if (major === 4) {
      const items: unknown[] = [];
      until(() => items.push(this.value(depth + 1)));
      return items;
    }
    if (major === 5) {
      const object: Record<string, unknown> = {};
      until(() => this.member(object, depth));
      return object;
    }
    const parts: unknown[] = [];
    until(() => parts.push(this.value(depth + 1)));
    if (major === 3) return parts.join("");
    throw new CborError("a string of bytes in pieces");
  }

  private tagged(tag: number, depth: number): unknown {
    const content = this.value(depth + 1);
    if (!(content instanceof Uint8Array)) return content;
    if (tag === 2 || tag === 3) {
      const magnitude = content.reduce((sum, byte) => sum * 256 + byte, 0);
      return tag === 2 ? magnitude : -1 - magnitude;
    }
    const read = TYPED_ARRAYS[tag];
    return read ? read(content.buffer as ArrayBuffer) : content;
  }

  private simple(info: number): unknown {
    switch (info) {
      case 20:
        return false;
      case 21:
        return true;
      case 22:
        return null;
      case 23:
        return undefined;
      case 25: {
        const half = this.view.getUint16(this.skip(2));
        const exponent = (half >> 10) & 31;
        const fraction = half & 1023;
        const size =
          exponent === 0
            ? fraction * 2 ** -24
            : exponent === 31
              ? fraction
                ? Number.NaN
                : Number.POSITIVE_INFINITY
              : (1 + fraction / 1024) * 2 ** (exponent - 15);
        return half & 0x8000 ? -size : size;
      }
      case 26:
        return this.view.getFloat32(this.skip(4));
      case 27:
        return this.view.getFloat64(this.skip(8));
      default:
        throw new CborError(`simple value ${info}`);
    }
  }

  private argument(info: number): number {
    if (info < 24) return info;
    if (info === 24) return this.view.getUint8(this.skip(1));
    if (info === 25) return this.view.getUint16(this.skip(2));
    if (info === 26) return this.view.getUint32(this.skip(4));
    if (info === 27) return Number(this.view.getBigUint64(this.skip(8)));
    throw new CborError(`additional information ${info}`);
  }

  private skip(count: number): number {
    const at = this.at;
    this.at += count;
    return at;
  }

  private take(count: number): Uint8Array {
    if (count > this.bytes.length - this.at)
      throw new CborError("the message ends in the middle of a string");
    return this.bytes.slice(this.skip(count), this.at);
  }
}

/** The members before the one of a name, of a message that is a map; none of another message. Throws as {@link decodeCbor}. */
export function membersBefore(bytes: Uint8Array, name: string): Record<string, unknown> {
  return new Decoder(bytes).before(name);
}

/** The value of one CBOR message. Throws where the bytes are none. */
export function decodeCbor(bytes: Uint8Array): unknown {
  return new Decoder(bytes).whole();
}
