// Chromium as it is on a machine without a graphics card, for measuring: told what to do by its DevTools protocol alone.
// Playwright has every message of every WebSocket repeated to it, in base64: that costs a processor half of its time where
// clouds come ten times a second. And the flags of the tests have the whole page painted by the rasteriser of WebGL, which
// Chromium does not do by itself: without a card it paints the page in a painter of its own.

import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const FLAGS = [
  '--headless',
  '--no-sandbox', // Chromium refuses to run as root with it, and containers have no namespaces for it.
  '--use-gl=angle',
  '--use-angle=swiftshader',
  '--enable-unsafe-swiftshader',
  '--disable-gpu-compositing',
  '--disable-dev-shm-usage',
  '--no-first-run',
  '--remote-debugging-pipe',
];

/** The DevTools of a browser, which are spoken to through two pipes: texts that a zero ends. */
function devtools(child) {
  const [, , , to, from] = child.stdio;
  const waiting = new Map();
  const listeners = new Map();
  let number = 0;
  let pieces = [];
  const receive = ({ id, method, params, result, error, sessionId }) => {
    if (method) {
      listeners.get(`${sessionId} ${method}`)?.(params);
      return;
    }
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    if (error) reject(new Error(error.message));
    else resolve(result);
  };
  from.on('data', (bytes) => {
    let start = 0;
    for (let end = bytes.indexOf(0); end >= 0; end = bytes.indexOf(0, start)) {
      pieces.push(bytes.subarray(start, end));
      receive(JSON.parse(Buffer.concat(pieces).toString()));
      pieces = [];
      start = end + 1;
    }
    pieces.push(bytes.subarray(start));
  });
  child.once('exit', () => {
    for (const { reject } of waiting.values()) reject(new Error('Chromium ended'));
  });
  /** What is said to a page, or without a session to the browser itself. */
  return (sessionId) => ({
    hear: (method, listener) => listeners.set(`${sessionId} ${method}`, listener),
    send: (method, params = {}) =>
      new Promise((resolve, reject) => {
        waiting.set(++number, { resolve, reject });
        to.write(`${JSON.stringify({ id: number, method, params, sessionId })}\0`);
      }),
  });
}

export async function launch(executablePath) {
  const profile = mkdtempSync(join(tmpdir(), 'chromium-'));
  const child = spawn(executablePath, [...FLAGS, `--user-data-dir=${profile}`], {
    stdio: ['ignore', 'ignore', 'inherit', 'pipe', 'pipe'],
  });
  const session = devtools(child);
  const whole = session();
  const { product } = await whole.send('Browser.getVersion');
  return {
    version: product,
    async open(width, height) {
      const { targetId } = await whole.send('Target.createTarget', { url: 'about:blank' });
      const { sessionId } = await whole.send('Target.attachToTarget', { targetId, flatten: true });
      const inspector = session(sessionId);
      await inspector.send('Page.enable');
      await inspector.send('Emulation.setDeviceMetricsOverride', { width, height, deviceScaleFactor: 1, mobile: false });
      let loaded = () => undefined;
      inspector.hear('Page.loadEventFired', () => loaded());
      return {
        page: {
          on: () => undefined,
          async goto(url) {
            const done = new Promise((resolve) => {
              loaded = resolve;
            });
            const { errorText } = await inspector.send('Page.navigate', { url });
            if (errorText) throw new Error(`${url}: ${errorText}`);
            await done;
          },
          async evaluate(expression) {
            const { result, exceptionDetails } = await inspector.send('Runtime.evaluate', {
              expression,
              returnByValue: true,
              awaitPromise: true,
            });
            if (exceptionDetails) throw new Error(exceptionDetails.exception?.description ?? exceptionDetails.text);
            return result.value;
          },
          async screenshot({ path }) {
            const { data } = await inspector.send('Page.captureScreenshot');
            writeFileSync(path, Buffer.from(data, 'base64'));
          },
        },
        inspect: inspector.send,
        async trace(seconds) {
          const traceEvents = [];
          whole.hear('Tracing.dataCollected', ({ value }) => traceEvents.push(...value));
          const complete = new Promise((resolve) => whole.hear('Tracing.tracingComplete', resolve));
          const includedCategories = ['toplevel', 'devtools.timeline', 'disabled-by-default-devtools.timeline'];
          await whole.send('Tracing.start', { traceConfig: { includedCategories } });
          await new Promise((later) => setTimeout(later, seconds * 1000));
          await whole.send('Tracing.end');
          await complete;
          return JSON.stringify({ traceEvents });
        },
        close: () => whole.send('Target.closeTarget', { targetId }),
      };
    },
    async close() {
      const ended = new Promise((resolve) => child.once('exit', resolve));
      await whole.send('Browser.close').catch(() => undefined); // It may be gone before it answers.
      child.kill();
      await ended;
      rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
    },
  };
}
