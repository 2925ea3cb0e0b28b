// Builds /lib/: the libraries of Robot Web Tools under the file names that their content delivery network had, each
// from its release on npm where there is one, with its licence, and index.html, which lists them.

import { copyFileSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { build } from "esbuild";

/**
 * name: of the file, without `.min.js`; from: the file of the package that is copied, and within: further packages that
 * its makers have bundled into it; entry: what is bundled here instead; global: what it leaves in a page; needs: what a
 * page loads before it.
 */
export const LIBRARIES = [
  {
    name: "roslib",
    package: "roslib1",
    from: "build/roslib.min.js",
    within: ["cbor-js", "eventemitter2", "object-assign", "webworkify"],
    global: "ROSLIB",
    needs: [],
  },
  { name: "roslib2", package: "roslib", entry: 'export * from "roslib"', global: "ROSLIB", needs: [] },
  { name: "roslib2.esm", package: "roslib", entry: 'export * from "roslib"', global: null, needs: [] },
  {
    name: "eventemitter2",
    package: "eventemitter2",
    entry: 'module.exports = require("eventemitter2").EventEmitter2',
    global: "EventEmitter2",
    needs: [],
  },
  {
    name: "eventemitter3.umd",
    package: "eventemitter3",
    from: "dist/eventemitter3.umd.min.js",
    global: "EventEmitter3",
    needs: [],
  },
  { name: "easeljs", package: "easeljs", from: "lib/easeljs.min.js", global: "createjs", needs: [] },
  { name: "three", package: "three89", from: "build/three.min.js", global: "THREE", needs: [] },
  {
    name: "ros2d",
    package: "ros2d",
    from: "build/ros2d.min.js",
    global: "ROS2D",
    needs: ["easeljs", "eventemitter2", "roslib"],
  },
  {
    name: "ros3d",
    package: "ros3d",
    from: "build/ros3d.min.js",
    within: ["three89", "eventemitter2"],
    global: "ROS3D",
    needs: ["roslib"],
  },
  {
    name: "keyboardteleop",
    entry: 'export * from "./keyboardteleop"',
    global: "KEYBOARDTELEOP",
    needs: ["roslib"],
  },
  {
    name: "nav2d",
    entry: 'export * from "./nav2d"',
    global: "NAV2D",
    needs: ["easeljs", "eventemitter2", "roslib", "ros2d"],
  },
  { name: "mjpegcanvas", entry: 'export * from "./mjpegcanvas"', global: "MJPEGCANVAS", needs: [] },
];

/** Makes all files in the folder `out`; `here` is the folder of the npm project, `shared` what every bundle has. */
export async function buildDropIns({ shared, here, out }) {
  mkdirSync(join(out, "licenses"), { recursive: true });
  const packages = join(here, "node_modules");
  const rows = [];
  for (const library of LIBRARIES) {
    const file = join(out, `${library.name}.min.js`);
    const made = library.from
      ? copyRelease(library, packages, file)
      : await bundle(library, file, shared, here);
    const licences = made.map((folder) => copyLicence(folder, join(out, "licenses")));
    rows.push({
      ...library,
      licences,
      version: versionOf(library, packages),
      bytes: readFileSync(file).length,
    });
  }
  writeFileSync(join(out, "index.html"), indexPage(rows));
}

/** Copies a library as it was released; returns the folders of the packages that are in it. */
function copyRelease({ package: released, from, within = [] }, packages, file) {
  copyFileSync(join(packages, released, from), file);
  return [released, ...within].map((each) => join(packages, each));
}

/** Bundles a library; returns the folders of the packages that went into it. */
async function bundle({ name, entry, global }, outfile, shared, here) {
  const { metafile } = await build({
    ...shared,
    stdin: { contents: entry, resolveDir: join(here, "src", "dropin") },
    outfile,
    ...(global ? { format: "iife", globalName: global } : { format: "esm" }),
    banner: { js: `/* ${name}.min.js: licenses in licenses/ beside this file */` },
  });
  const folders = new Set();
  for (const input of Object.keys(metafile.inputs)) {
    const folder = /^(.*node_modules\/(?:@[^/]+\/)?[^/]+)\//.exec(input)?.[1];
    if (folder) folders.add(join(here, folder));
  }
  return [...folders].sort();
}

function versionOf(library, packages) {
  return library.package ? readJson(join(packages, library.package, "package.json")).version : "";
}

/** Copies a package's licence; returns its name, version, kind and the file. */
function copyLicence(folder, out) {
  const { name, version, license } = readJson(join(folder, "package.json"));
  const text = readdirSync(folder).find((each) => /^licen[cs]e/i.test(each));
  if (!text) throw new Error(`${folder} comes without the text of its licence`);
  const file = `${name.replaceAll("/", "-").replace("@", "")}-${version}.txt`;
  copyFileSync(join(folder, text), join(out, file));
  return { name, version, license, file };
}

function readJson(path) {
  return JSON.parse(readFileSync(path, "utf8"));
}

function indexPage(rows) {
  const cells = rows.map(({ name, global, needs, licences, package: origin, version, bytes }) => {
    const made = origin
      ? `${licences.find((each) => each.version === version)?.name} ${version}`
      : "Robot Web Tools";
    const notices = licences
      .map((each) => `<a href="licenses/${each.file}">${each.name} ${each.version}: ${each.license}</a>`)
      .join("<br>");
    const before = needs.map((each) => `<code>${each}.min.js</code>`).join(", ") || "-";
    return (
      `<tr><td><a href="${name}.min.js">${name}.min.js</a><td>${made}<td>${global ?? "an ES module"}` +
      `<td>${before}<td>${Math.round(bytes / 1024)} KB<td>${notices || "-"}`
    );
  });
  return `<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>Libraries of Robot Web Tools</title>
<h1>Libraries for pages of your own</h1>
<p>Load them from here as from a content delivery network, in any page and from any origin.
Folders before a name and the <code>.min</code> in it make no difference:
<code>/lib/roslibjs/current/roslib.js</code> is <code>/lib/roslib.min.js</code>.
<table border>
<caption>What is here, of which release, and what a page has to load before it</caption>
<thead><tr><th scope="col">file<th scope="col">from<th scope="col">global<th scope="col">needs<th scope="col">size
<th scope="col">licences</thead>
<tbody>
${cells.join("\n")}
</tbody></table>
`;
}
