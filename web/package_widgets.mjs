// Lays the built elements out as an npm package: `node package_widgets.mjs [FOLDER]`, by default dist/widgets. `npm run build`
// has to come first.

import { copyFileSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const built = join(here, "..", "src", "rwt", "extensions", "dashboard", "static", "web");
const out = resolve(process.argv[2] ?? join(here, "dist", "widgets"));

/** The version of the Python distribution, which has the same elements in it. */
const version = /^version = "([^"]+)"$/m.exec(readFileSync(join(here, "..", "pyproject.toml"), "utf8"))?.[1];
if (!version) throw new Error("pyproject.toml has no line `version = …`");
const scripts = readdirSync(built).filter((name) => /^widgets.*\.js$/.test(name));
if (!scripts.includes("widgets.js"))
  throw new Error(`${built} has no widgets.js: run \`npm run build\` first`);

const manifest = {
  name: "@robot-web-tools/widgets",
  // npm writes a candidate as 1.0.0-rc1, Python as 1.0.0rc1.
  version: version.replace(/(?<=\d)(?=(a|b|rc)\d+$)/, "-"),
  description:
    "Elements of HTML that show and drive a robot over rosbridge: <rwt-video>, <rwt-teleop> and others.",
  keywords: ["robotics", "ros", "rosbridge", "custom-elements", "web-components"],
  license: "BSD-3-Clause",
  author: "The Robot Web Tools without ROS authors",
  type: "module",
  exports: {
    ".": { types: "./widgets.d.ts", default: "./widgets.js" },
    "./react": { types: "./react.d.ts" },
  },
  types: "./widgets.d.ts",
  sideEffects: true,
  files: ["*.js", "*.d.ts", "licenses.txt"],
};

rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });
for (const name of scripts) copyFileSync(join(built, name), join(out, name));
copyFileSync(join(built, "licenses.txt"), join(out, "licenses.txt"));
for (const name of readdirSync(join(here, "package"))) {
  copyFileSync(join(here, "package", name), join(out, name));
}
copyFileSync(join(here, "..", "LICENSE"), join(out, "LICENSE"));
writeFileSync(join(out, "package.json"), `${JSON.stringify(manifest, null, 2)}\n`);
console.log(`${out}: ${scripts.length} scripts`);
