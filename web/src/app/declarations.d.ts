declare module "*.css";
/** The file name of the decoding worker beside the page's script. */
declare const DECODE_WORKER: string;
/** The file name of the worker that plays a recording. */
declare const RECORDING_WORKER: string;
/** The file of what runs beside the page where it takes sound from the microphone. */
declare const MICROPHONE_WORKLET: string;
