declare module "*.css";
/** The file name of the decoding worker beside the page's script. */
declare const DECODE_WORKER: string;
