/** Compressed clouds, whose decoder is loaded with the first of them. */

import type { CompressedCloud } from "./cloud_planes";

declare global {
  /** Name of the script that defines `decompressCloud`, beside the worker's own. */
  const CLOUD_PLANES: string;
  var decompressCloud: ((cloud: CompressedCloud) => Uint8Array) | undefined;
  function importScripts(...urls: string[]): void;
}

/** Value of the field `format`; docs/reference/point-clouds.md describes it. */
const FORMAT = "rwt_planes";

/** Replace a compressed cloud by the whole one, in place; whether it was one. Messages of other kinds stay as they are. */
export function makeWhole(message: Record<string, unknown>): boolean {
  if (message.format !== FORMAT || message.compressed_data === undefined) return false;
  if (!self.decompressCloud) importScripts(CLOUD_PLANES);
  message.data = self.decompressCloud?.(message as unknown as CompressedCloud);
  delete message.compressed_data;
  delete message.format;
  return true;
}
