// Runs the script of an HTML page in Node: the page's library is the real one, its document a small stand-in.
// Usage: node page_in_node.mjs PAGE.html FOLDER_WITH_NODE_MODULES
// Texts of elements are printed whenever the page sets them; every button is pressed once.

import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import vm from 'node:vm';

const [page, folder] = process.argv.slice(2);
const { WebSocket } = createRequire(join(folder, 'node_modules', 'roslib1', 'package.json'))('ws');
const html = readFileSync(page, 'utf8');
const elements = new Map();
const pressed = [];

function element(id) {
  if (!html.includes(`id="${id}"`)) throw new Error(`the page has no element with id "${id}"`);
  if (!elements.has(id)) {
    elements.set(id, {
      set textContent(text) { console.log(`${id}: ${text}`); },
      addEventListener(kind, listener) { pressed.push(listener); },
      set onclick(listener) { pressed.push(listener); },
    });
  }
  return elements.get(id);
}

const window = { WebSocket, console, setInterval, clearInterval, setTimeout, clearTimeout, Math, JSON };
window.window = window.self = window;
window.document = { getElementById: element };
vm.createContext(window);
for (const [, attributes, code] of html.matchAll(/<script([^>]*)>(.*?)<\/script>/gs)) {
  const source = /src="[^"]*node_modules\/roslib\/([^"]*)"/.exec(attributes);
  const text = source ? readFileSync(join(folder, 'node_modules', 'roslib1', source[1]), 'utf8') : code;
  vm.runInContext(text, window, { filename: source ? source[1] : page });
}
setTimeout(() => pressed.forEach((listener) => listener({})), 500);
