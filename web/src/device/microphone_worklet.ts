/** Runs on the browser's audio thread: gathers samples, and hands them to the page as 16-bit integers. */

// TypeScript has no declarations for this scope (Web Audio API, section 1.32).
declare const sampleRate: number;
declare function registerProcessor(name: string, processor: unknown): void;
declare class AudioWorkletProcessor {
  readonly port: MessagePort;
}

/** Messages a second. */
const RATE = 20;
const HIGHEST = 0x7fff;

class Microphone extends AudioWorkletProcessor {
  private readonly length = Math.ceil(sampleRate / RATE);
  private samples = new DataView(new ArrayBuffer(2 * this.length));
  private filled = 0;

  /** Called for every 128 samples; to go on it returns true. */
  process([input]: Float32Array[][]): boolean {
    for (const sample of input?.[0] ?? []) {
      const bounded = Math.max(-1, Math.min(1, sample));
      this.samples.setInt16(2 * this.filled, Math.round(bounded * HIGHEST), true);
      if (++this.filled === this.length) this.send();
    }
    return true;
  }

  private send(): void {
    const { buffer } = this.samples;
    this.port.postMessage(buffer, [buffer]);
    this.samples = new DataView(new ArrayBuffer(2 * this.length));
    this.filled = 0;
  }
}

registerProcessor("microphone", Microphone);
