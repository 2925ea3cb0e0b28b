// Drives one headless Chromium for all tests: a JSON object on each line of standard input is a command, and a JSON
// object on standard output its answer. Usage: node browser.mjs CHROMIUM FOLDER
// FOLDER gets the bundle of the libraries that browsers cannot load as they are.

import { createInterface } from 'node:readline';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { buildSync } from 'esbuild';
import { chromium } from 'playwright-core';

const [executablePath, folder] = process.argv.slice(2);

// roslib 2 is made of modules only: one script with the global that pages know. EventEmitter2 the same.
for (const [name, code] of Object.entries({
  ROSLIB: 'export * from "roslib"',
  EventEmitter2: 'module.exports = require("eventemitter2").EventEmitter2',
})) {
  buildSync({
    stdin: { contents: code, resolveDir: dirname(fileURLToPath(import.meta.url)) },
    bundle: true,
    format: 'iife',
    platform: 'browser',
    globalName: name,
    outfile: join(folder, `${name}.js`),
    logLevel: 'error',
  });
}

const browser = await chromium.launch({
  executablePath,
  args: [
    '--no-sandbox', // Chromium refuses to run as root with it, and containers have no namespaces for it.
    '--use-gl=angle', // WebGL in software: the machines that test have no graphics card.
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
    '--autoplay-policy=no-user-gesture-required',
    '--disable-dev-shm-usage',
    // A camera that shows a test picture, and that nobody is asked for.
    '--use-fake-device-for-media-stream',
    '--use-fake-ui-for-media-stream',
  ],
});
const pages = new Map();

const commands = {
  async open({ page: name, url, width, height }) {
    const context = await browser.newContext({ viewport: { width, height }, deviceScaleFactor: 1 });
    const page = await context.newPage();
    page.setDefaultTimeout(60000); // Less than the one who asks waits for the answer.
    const complaints = [];
    page.on('console', (message) => {
      const { url: source } = message.location();
      // Browsers ask for an icon by themselves, and complain when there is none.
      if (message.type() === 'error' && !source.endsWith('/favicon.ico')) complaints.push(`${message.text()} (${source})`);
    });
    page.on('pageerror', (error) => complaints.push(`exception: ${error.stack ?? error}`));
    pages.set(name, { context, page, complaints });
    await page.goto(url, { waitUntil: 'load' });
  },
  goto: async ({ page, url }) => void (await pages.get(page).page.goto(url, { waitUntil: 'load' })),
  evaluate: ({ page, script }) => pages.get(page).page.evaluate(script),
  // Polled by time and not by frame: a page that draws in software has few frames. And by evaluations of its
  // own, since `waitForFunction` evaluates a text within the page, which a page's policy may forbid.
  wait: async ({ page, script, timeout }) => {
    const late = Date.now() + timeout;
    for (;;) {
      const found = await pages.get(page).page.evaluate(script).catch((error) => {
        if (!/context was destroyed/.test(error.message)) throw error; // the page is being loaded again
      });
      if (found) return found;
      if (Date.now() > late) throw new Error(`never came true: ${script}`);
      await new Promise((later) => setTimeout(later, 50));
    }
  },
  screenshot: async ({ page, path }) => void (await pages.get(page).page.screenshot({ path })),
  mouse: ({ page, action, args }) => pages.get(page).page.mouse[action](...args),
  keyboard: ({ page, action, args }) => pages.get(page).page.keyboard[action](...args),
  click: ({ page, selector }) => pages.get(page).page.click(selector),
  complaints: ({ page }) => pages.get(page).complaints,
  async close({ page }) {
    await pages.get(page).context.close();
    pages.delete(page);
  },
};

console.log(JSON.stringify({ answer: browser.version() }));
for await (const line of createInterface({ input: process.stdin })) {
  const { command, number, ...rest } = JSON.parse(line);
  try {
    console.log(JSON.stringify({ number, answer: (await commands[command](rest)) ?? null }));
  } catch (error) {
    console.log(JSON.stringify({ number, failed: String(error.message ?? error) }));
  }
}
await browser.close();
