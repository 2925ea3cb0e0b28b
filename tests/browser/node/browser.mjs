// Drives one browser for all tests: a JSON object on each line of standard input is a command, and a JSON object on
// standard output its answer. Usage: node browser.mjs DRIVER PROGRAM FOLDER
// DRIVER is the module that knows the browser, PROGRAM the browser itself, and FOLDER gets the bundle of the libraries
// that browsers cannot load as they are.

import { writeFileSync } from 'node:fs';
import { createInterface } from 'node:readline';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { buildSync } from 'esbuild';
import { witness } from './witness.mjs';

const [driver, executablePath, folder] = process.argv.slice(2);
const { launch } = await import(driver);

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

const browser = await launch(executablePath);
const pages = new Map();

const commands = {
  async open({ page: name, url, width, height, locale }) {
    const opened = await browser.open(width, height, locale);
    const { page } = opened;
    const complaints = [];
    page.on('console', (message) => {
      const { url: source } = message.location();
      // Browsers ask for an icon by themselves, and complain when there is none.
      if (message.type() === 'error' && !source.endsWith('/favicon.ico')) complaints.push(`${message.text()} (${source})`);
    });
    page.on('pageerror', (error) => complaints.push(`exception: ${error.stack ?? error}`));
    pages.set(name, { ...opened, complaints, report: witness(page) });
    await page.goto(url, { waitUntil: 'load' });
  },
  goto: async ({ page, url }) => void (await pages.get(page).page.goto(url, { waitUntil: 'load' })),
  evaluate: ({ page, script }) => pages.get(page).page.evaluate(script),
  // Polled by time and not by frame: a page that draws in software has few frames. And by evaluations of its
  // own, since `waitForFunction` evaluates a text within the page, which a page's policy may forbid.
  wait: async ({ page, script, timeout }) => {
    const late = Date.now() + timeout;
    for (;;) {
      // A node of the page cannot leave it.
      const found = await pages.get(page).page.evaluate(`(it => it instanceof Node || it)(${script})`).catch((error) => {
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
  click: ({ page, selector }) => pages.get(page).click(selector),
  // What only Chromium tells of itself.
  inspect: ({ page, method, params }) => pages.get(page).inspect(method, params),
  trace: async ({ page, seconds, path }) => void writeFileSync(path, await pages.get(page).trace(seconds)),
  complaints: ({ page }) => pages.get(page).complaints,
  report: ({ page }) => pages.get(page).report(),
  async close({ page }) {
    await pages.get(page).close();
    pages.delete(page);
  },
};

console.log(JSON.stringify({ answer: browser.version }));
for await (const line of createInterface({ input: process.stdin })) {
  const { command, number, ...rest } = JSON.parse(line);
  try {
    console.log(JSON.stringify({ number, answer: (await commands[command](rest)) ?? null }));
  } catch (error) {
    console.log(JSON.stringify({ number, failed: String(error.message ?? error) }));
  }
}
await browser.close();
