// Lays the built elements out as an npm package, in dist/widgets; `npm run build` has to come first.

import { copyFileSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const built = join(here, "..", "src", "rwt_web", "static", "web");
const out = join(here, "dist", "widgets");

const { version } = JSON.parse(readFileSync(join(here, "package.json"), "utf8"));
const scripts = readdirSync(built).filter((name) => /^widgets.*\.js$/.test(name));
if (!scripts.includes("widgets.js"))
  throw new Error(`${built} has no widgets.js: run \`npm run build\` first`);

rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });
for (const name of scripts) copyFileSync(join(built, name), join(out, name));
copyFileSync(join(here, "..", "LICENSE"), join(out, "LICENSE"));
const manifest = {
  name: "@robot-web-tools/widgets",
  version,
  description:
    "Elements of HTML that show and drive a robot over rosbridge: <rwt-video>, <rwt-teleop> and others.",
  license: "BSD-3-Clause",
  type: "module",
  exports: "./widgets.js",
  sideEffects: true,
  files: ["*.js"],
};
writeFileSync(join(out, "package.json"), `${JSON.stringify(manifest, null, 2)}\n`);
console.log(`${out}: ${scripts.length} files`);
