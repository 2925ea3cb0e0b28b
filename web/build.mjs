// Builds the page into src/rwt/extensions/dashboard/static: bundles with hashed names, a compressed copy beside each file, and
// manifest.json, the list of what is served and how. Ends with 1 where a budget of budgets.json is exceeded.

import { createHash } from "node:crypto";
import { existsSync, mkdirSync, readdirSync, readFileSync, rmSync, watch, writeFileSync } from "node:fs";
import { basename, dirname, extname, join, relative } from "node:path";
import { fileURLToPath } from "node:url";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "..", "src", "rwt", "extensions", "dashboard", "static");

const TYPES = {
  ".html": "text/html; charset=utf-8",
  ".js": "text/javascript; charset=utf-8",
  ".css": "text/css; charset=utf-8",
  ".svg": "image/svg+xml",
  ".json": "application/json",
  ".txt": "text/plain; charset=utf-8",
  ".webmanifest": "application/manifest+json",
  ".woff2": "font/woff2",
};

/**
 * dockview-core's release has its style only as a text that a script puts into the page, which the page's policy
 * forbids: here it becomes a style sheet, without the themes that are not used.
 */
const dockviewStyle = {
  name: "dockview-style",
  setup({ onResolve, onLoad }) {
    onResolve({ filter: /^dockview-core\/style\.css$/ }, ({ path }) => ({
      path,
      namespace: "dockview-style",
    }));
    onLoad({ filter: /.*/, namespace: "dockview-style" }, () => {
      const script = readFileSync(join(here, "node_modules/dockview-core/dist/dockview-core.js"), "utf8");
      const text = /\.textContent = ("(?:[^"\\]|\\.)*")/.exec(script)?.[1];
      if (!text) throw new Error("dockview-core no longer has its style where it was");
      const unused = /(^|\n)\.dockview-theme-(?!light\b|dark\b)[^{]*\{[^}]*\}/g;
      return { contents: JSON.parse(text).replace(unused, ""), loader: "css" };
    });
  },
};

/** A library of roslib's would multiply by WebAssembly, and does without where a page's policy forbids it; the attempt alone
 * is an error on Firefox's console. */
const NO_WASM = { WebAssembly: "undefined" };

const shared = {
  absWorkingDir: here,
  bundle: true,
  minify: true,
  target: ["es2022"],
  legalComments: "none",
  jsx: "automatic",
  jsxImportSource: "preact",
  metafile: true,
  logLevel: "warning",
  plugins: [dockviewStyle],
  loader: { ".woff2": "file" },
  assetNames: "[name]-[hash]",
};

/** Folders of the packages parts of which are in the bundles below web/. */
const bundled = new Set();

/** Bundles, and remembers whose code went into it. */
async function bundle(options) {
  const result = await build({ ...shared, ...options });
  for (const input of Object.keys(result.metafile.inputs)) {
    const folder = /^(.*node_modules\/(?:@[^/]+\/)?[^/]+)\//.exec(input)?.[1];
    if (folder) bundled.add(folder);
  }
  return result;
}

/** One bundle of its own with a hashed name; returns its file name. */
async function bundleAlone(entry, folder, options = {}) {
  const result = await bundle({
    entryPoints: [entry],
    outdir: join(out, folder),
    entryNames: "[name]-[hash]",
    format: "iife",
    ...options,
  });
  return basename(Object.keys(result.metafile.outputs).find((name) => name.endsWith(".js")));
}

async function buildAll() {
  rmSync(out, { recursive: true, force: true });
  mkdirSync(join(out, "web"), { recursive: true });
  bundled.clear();

  const planes = {
    CLOUD_PLANES: JSON.stringify(await bundleAlone("src/decode/cloud_planes_script.ts", "web")),
  };
  const worker = await bundleAlone("src/decode/worker.ts", "web", { define: planes });
  const recordingWorker = await bundleAlone("src/decode/recording_worker.ts", "web", { define: planes });
  const worklet = await bundleAlone("src/device/microphone_worklet.ts", "web");
  const page = await bundle({
    entryPoints: { app: "src/app/main.tsx" },
    outdir: join(out, "web"),
    entryNames: "[name]-[hash]",
    chunkNames: "[name]-[hash]",
    format: "esm",
    splitting: true,
    define: {
      DECODE_WORKER: JSON.stringify(worker),
      RECORDING_WORKER: JSON.stringify(recordingWorker),
      MICROPHONE_WORKLET: JSON.stringify(worklet),
      ...NO_WASM,
    },
  });
  const [script, { cssBundle }] = Object.entries(page.metafile.outputs).find(
    ([, output]) => output.entryPoint === "src/app/main.tsx",
  );
  // The style of what is loaded later is part of the page's own: a style sheet of its own would come too late.
  for (const name of Object.keys(page.metafile.outputs)) {
    if (name.endsWith(".css") && name !== cssBundle) rmSync(join(here, name));
  }
  const icon = readFileSync(join(here, "src", "app", "icon.svg"), "utf8");
  // Otherwise the browser would ask for what the script imports only when it has read the script.
  const preloads = [...loadedWith(script, page.metafile.outputs)]
    .filter((name) => name !== script && name !== cssBundle)
    .map((name) => `<link rel="modulepreload" href="web/${basename(name)}">`);
  const document = readFileSync(join(here, "src", "app", "index.html"), "utf8")
    .replace("ICON", icon.replace(/^<svg[^>]*>\s*<title>.*?<\/title>|<\/svg>\s*$/g, ""))
    .replace("APP_CHUNKS", preloads.join("\n"))
    .replace("APP_SCRIPT", `web/${basename(script)}`)
    .replace("APP_STYLE", `web/${basename(cssBundle)}`);
  writeFileSync(join(out, "index.html"), document);
  for (const name of ["icon.svg", "app.webmanifest"]) {
    writeFileSync(join(out, "web", name), readFileSync(join(here, "src", "app", name)));
  }
  await buildForOtherPages();
  writeLicenses();
  writeManifest();
  checkBudgets(page.metafile.outputs, worker);
}

/** The pages that the documentation shows; here they take the script from the server that they come from. */
function buildPages() {
  const folder = join(here, "pages");
  mkdirSync(join(out, "web", "pages"), { recursive: true });
  for (const name of readdirSync(folder)) {
    const page = readFileSync(join(folder, name), "utf8");
    writeFileSync(join(out, "web", "pages", name), page.replaceAll("http://127.0.0.1:9090/web/", "../"));
  }
}

/** The decoding worker as a text: a page of another origin may start no worker from a file of this one. */
async function workerSource() {
  const { outputFiles } = await bundle({
    entryPoints: ["src/decode/inline_worker.ts"],
    format: "iife",
    define: { CLOUD_PLANES: '""' },
    write: false,
    outdir: out,
  });
  return outputFiles[0].text;
}

/** Files that other pages load: names without hashes, since their authors write them down. */
async function buildForOtherPages() {
  const widgets = join(here, "src", "elements", "widgets.ts");
  if (existsSync(widgets)) {
    await bundle({
      entryPoints: { widgets },
      outdir: join(out, "web"),
      format: "esm",
      splitting: true,
      chunkNames: "widgets-[name]-[hash]",
      define: { DECODE_WORKER_SOURCE: JSON.stringify(await workerSource()), ...NO_WASM },
    });
  }
  buildPages();
  const recipe = join(here, "src", "dropin", "build.mjs");
  if (existsSync(recipe)) {
    const { buildDropIns } = await import(`${recipe}?${Date.now()}`);
    await buildDropIns({ shared, here, out: join(out, "lib") });
  }
}

function filesBelow(folder) {
  return readdirSync(folder, { withFileTypes: true, recursive: true })
    .filter((entry) => entry.isFile())
    .map((entry) => relative(out, join(entry.parentPath, entry.name)))
    .sort();
}

/** The licences of the packages that are in the bundles. */
function writeLicenses() {
  const packages = [...bundled].sort().map((folder) => {
    const { name, version, license } = JSON.parse(readFileSync(join(here, folder, "package.json"), "utf8"));
    const files = readdirSync(join(here, folder)).filter((file) => /^(licen[cs]e|notice)/i.test(file));
    const texts = files.map((file) => readFileSync(join(here, folder, file), "utf8").trim());
    return { title: `${name} ${version}`, license, texts };
  });
  const parts = packages.map(({ title, license, texts }) => {
    if (texts.length) return [`${title} (${license})`, ...texts].join("\n\n");
    // This licence has one text for everybody; others name who holds the copyright.
    const same = packages.find((other) => other.license === license && other.texts.length);
    if (license !== "Apache-2.0" || !same) throw new Error(`${title} comes without the text of its licence`);
    return `${title} (${license})\n\nIts release has no text of the licence; it is that of ${same.title} in this file.`;
  });
  writeFileSync(join(out, "web", "licenses.txt"), `${parts.join(`\n\n${"-".repeat(80)}\n\n`)}\n`);
}

function writeManifest() {
  const manifest = {};
  for (const name of filesBelow(out)) {
    const bytes = readFileSync(join(out, name));
    const encodings = [];
    const compressed = {
      br: brotliCompressSync(bytes, { params: { [constants.BROTLI_PARAM_QUALITY]: 11 } }),
      gzip: gzipSync(bytes, { level: 9 }),
    };
    for (const [encoding, suffix] of [
      ["br", ".br"],
      ["gzip", ".gz"],
    ]) {
      if (compressed[encoding].length < bytes.length * 0.95) {
        writeFileSync(join(out, name + suffix), compressed[encoding]);
        encodings.push(encoding);
      }
    }
    manifest[name] = {
      type: TYPES[extname(name)] ?? "application/octet-stream",
      hash: createHash("sha256").update(bytes).digest("hex").slice(0, 20),
      immutable: /-[A-Z0-9]{8}\.(js|css|woff2)$/.test(name),
      encodings,
      bytes: bytes.length,
      sent: encodings.includes("br") ? compressed.br.length : bytes.length,
    };
  }
  writeFileSync(join(out, "manifest.json"), `${JSON.stringify(manifest, null, 1)}\n`);
}

/** The outputs that a script loads at once, itself included. */
function loadedWith(name, outputs, found = new Set()) {
  if (!found.has(name)) {
    found.add(name);
    const { imports, cssBundle } = outputs[name];
    if (cssBundle) found.add(cssBundle);
    for (const { path, kind } of imports) if (kind === "import-statement") loadedWith(path, outputs, found);
  }
  return found;
}

/** budgets.json: for the page, and for each part that is loaded later, how much more is sent for it. */
function checkBudgets(outputs, worker) {
  const manifest = JSON.parse(readFileSync(join(out, "manifest.json"), "utf8"));
  const budgets = JSON.parse(readFileSync(join(here, "budgets.json"), "utf8"));
  const byEntry = (entry) => Object.keys(outputs).find((name) => outputs[name].entryPoint === entry);
  const first = loadedWith(byEntry("src/app/main.tsx"), outputs);
  for (const [entry, kilobytes] of Object.entries(budgets)) {
    const name = byEntry(entry);
    if (!name) throw new Error(`budgets.json names ${entry}, which is no entry point or imported later`);
    const loaded = [...loadedWith(name, outputs)]
      .map((each) => relative(out, join(here, each)))
      .filter((each) => each in manifest); // the style of what is loaded later is in the page's own
    const known = new Set([...first].map((each) => relative(out, join(here, each))));
    const isFirst = name === byEntry("src/app/main.tsx");
    const counted = isFirst
      ? [...loaded, "index.html", `web/${worker}`]
      : loaded.filter((each) => !known.has(each));
    const sent = counted.reduce((sum, each) => sum + manifest[each].sent, 0) / 1024;
    const line = `${entry}: ${sent.toFixed(1)} KB with brotli, of ${kilobytes} KB`;
    if (sent > kilobytes) {
      console.error(`over the budget: ${line}`);
      process.exitCode = 1;
    } else {
      console.log(line);
    }
  }
}

await buildAll();
if (process.argv.includes("--watch")) {
  let timer;
  watch(join(here, "src"), { recursive: true }, () => {
    clearTimeout(timer);
    timer = setTimeout(() => buildAll().catch((error) => console.error(error.message)), 200);
  });
}
