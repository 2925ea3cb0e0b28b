/** LZ4 frames (lz4_Frame_format.md 1.6.4), without their checksums: an MCAP file has its own. */

const MAGIC = 0x184d2204;

/**
 * The content of a frame.
 *
 * @param size bytes of the content
 * @throws Error it is no frame, or its content has another size
 */
export function decompressLz4(frame: Uint8Array, size: number): Uint8Array {
  const view = new DataView(frame.buffer, frame.byteOffset, frame.byteLength);
  if (view.getUint32(0, true) !== MAGIC) throw new Error("no LZ4 frame");
  const flags = view.getUint8(4);
  const content = new Uint8Array(size);
  let to = 0;
  for (let at = 7 + (flags & 8 ? 8 : 0) + (flags & 1 ? 4 : 0); ; ) {
    const head = view.getUint32(at, true);
    if (head === 0) break;
    at += 4;
    const end = at + (head & 0x7fffffff);
    if (end > frame.length) throw new Error("an LZ4 block is cut");
    if (head >>> 31) {
      content.set(frame.subarray(at, end), to);
      to += end - at;
    } else to = readBlock(frame.subarray(at, end), content, to);
    at = end + (flags & 16 ? 4 : 0);
  }
  if (to !== size) throw new Error(`LZ4: ${to} bytes instead of ${size}`);
  return content;
}

function readBlock(block: Uint8Array, content: Uint8Array, start: number): number {
  let to = start;
  let at = 0;
  const lengthOf = (first: number) => {
    let length = first;
    if (first === 15) {
      let more: number;
      do {
        more = block[at++] ?? 0;
        length += more;
      } while (more === 255);
    }
    return length;
  };
  while (at < block.length) {
    const token = block[at++] as number;
    const literals = lengthOf(token >> 4);
    content.set(block.subarray(at, at + literals), to);
    at += literals;
    to += literals;
    if (at >= block.length) break;
    const from = to - ((block[at++] as number) | ((block[at++] ?? 0) << 8));
    const length = lengthOf(token & 15) + 4;
    if (from < 0 || from >= to || to + length > content.length) throw new Error("a bad LZ4 block");
    for (let place = 0; place < length; place++) content[to + place] = content[from + place] as number;
    to += length;
  }
  return to;
}
