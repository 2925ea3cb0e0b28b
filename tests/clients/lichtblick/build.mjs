// Bundles Lichtblick's own player for Foxglove's protocol, as it is in a checkout: `node build.mjs CHECKOUT OUT.mjs`.

import { build } from 'esbuild';
import fs from 'node:fs';
import path from 'node:path';

const [checkout, outfile] = process.argv.slice(2).map((each) => path.resolve(each));
const packages = path.join(checkout, 'packages');
const modules = path.join(import.meta.dirname, 'node_modules');

// The workspaces of the checkout, which no registry has; the aliases of its own build.
const own = {
  name: 'workspaces of Lichtblick',
  setup(builder) {
    builder.onResolve({ filter: /^@lichtblick\/(suite-base|den|log|mcap-support|suite|hooks|message-path)(\/|$)/ }, (asked) => {
      const [, name, rest] = /^@lichtblick\/([^/]+)\/?(.*)$/.exec(asked.path);
      const base = path.join(packages, name, name === 'den' ? '' : 'src', rest);
      const found = ['.ts', '.tsx', '/index.ts', '/index.tsx'].map((end) => base + end).find(fs.existsSync);
      return found ? { path: found } : { errors: [{ text: `${checkout} has no ${base}.ts` }] };
    });
  },
};

await build({
  entryPoints: [path.join(packages, 'suite-base/src/players/FoxgloveWebSocketPlayer/index.ts')],
  outfile,
  bundle: true,
  platform: 'node',
  format: 'esm',
  nodePaths: [modules],
  plugins: [own],
  logLevel: 'error',
  loader: { '.wasm': 'binary' },
  tsconfigRaw: {},
  // What webpack would put there; nothing is read by it here.
  define: { 'import.meta.url': '"file:///player"', __dirname: '"player"', __filename: '"player"' },
  banner: {
    js: `import { createRequire } from 'node:module'; const require = createRequire(${JSON.stringify(modules + '/x.js')});`,
  },
});
