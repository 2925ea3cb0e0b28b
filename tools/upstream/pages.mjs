// Opens example pages of a checkout in Chromium with nothing changed but the host of their scripts, which become the
// server's /lib/, does in each what a visitor would do, and looks at what reaches the robot or the picture.
// Usage: node pages.mjs HTTP_URL PAGE..., in the checkout; the exit code is 0 where every page did what it is for.

import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { join, normalize } from "node:path";

const require = createRequire(new URL("../../tests/browser/node/package.json", import.meta.url));
const { chromium } = require("playwright-core");
const PATIENCE = 20_000;

const [robot, ...pages] = process.argv.slice(2);

/** The same page, with the scripts of Robot Web Tools from the robot. */
function withHost(page) {
  return page.replace(/(<script[^>]*\bsrc=")([^"]+)"/g, (tag, before, source) => {
    const isOurs = /robotwebtools|^\.\.\/build\//i.test(source);
    return isOurs ? `${before}${robot}/lib/${source.replace(/^.*\//, "")}"` : tag;
  });
}

const server = createServer(async ({ url }, response) => {
  if (url === "/watcher") {
    response.setHeader("Content-Type", "text/html");
    response.end("<!doctype html><title>watcher</title>");
    return;
  }
  const path = normalize(decodeURIComponent(new URL(url, "http://here").pathname)).replace(/^(\.\.\/)+/, "");
  try {
    const bytes = await readFile(join(process.cwd(), path));
    const isPage = path.endsWith(".html");
    response.setHeader("Content-Type", isPage ? "text/html; charset=utf-8" : "application/octet-stream");
    response.end(isPage ? withHost(bytes.toString()) : bytes);
  } catch {
    response.writeHead(404).end();
  }
});
await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
const site = `http://127.0.0.1:${server.address().port}/`;

/** Hear messages of a topic until one is right. */
function hears(watcher, topic, type, isRight) {
  return watcher.evaluate(
    ([url, topic, type, test, patience]) =>
      new Promise((resolve, reject) => {
        const socket = new WebSocket(url);
        const isRight = new Function("msg", `return ${test}`);
        socket.onopen = () => socket.send(JSON.stringify({ op: "subscribe", topic, type }));
        socket.onmessage = ({ data }) => {
          const { msg } = JSON.parse(data);
          if (msg && isRight(msg)) resolve(msg);
        };
        setTimeout(() => reject(new Error(`nothing right came on ${topic}`)), patience);
      }),
    [robot.replace("http", "ws"), topic, type, isRight, PATIENCE],
  );
}

async function until(page, what, isSo) {
  for (const end = Date.now() + PATIENCE; Date.now() < end; ) {
    if (await isSo()) return;
    await page.waitForTimeout(100);
  }
  throw new Error(`${what}: not within ${PATIENCE / 1000} s`);
}

/** How many pixels of a canvas are of a colour, as a picture of the page shows it. */
async function pixels(page, red, green, blue) {
  const shot = (await page.locator("canvas").first().screenshot()).toString("base64");
  return page.evaluate(
    async ([shot, red, green, blue]) => {
      const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${shot}`)).blob());
      const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
      context.drawImage(image, 0, 0);
      const { data } = context.getImageData(0, 0, image.width, image.height);
      let count = 0;
      for (let at = 0; at < data.length; at += 4) {
        const far = Math.max(Math.abs(data[at] - red), Math.abs(data[at + 1] - green), Math.abs(data[at + 2] - blue));
        if (far < 30) count++;
      }
      return count;
    },
    [shot, red, green, blue],
  );
}

const VISITS = {
  "keyboardteleop.html": async (page, watcher) => {
    const heard = hears(watcher, "/base_controller/command", "geometry_msgs/Twist", "msg.linear.x > 0.3");
    await page.bringToFront();
    await page.waitForTimeout(1000);
    await page.keyboard.down("ArrowUp");
    await heard;
    const stands = hears(watcher, "/base_controller/command", "geometry_msgs/Twist", "msg.linear.x === 0");
    await watcher.waitForTimeout(500);
    await page.keyboard.up("ArrowUp");
    await stands;
  },
  "mjpegcanvas.html": (page) => until(page, "the camera's red", async () => (await pixels(page, 255, 0, 0)) > 100_000),
  "multicanvas.html": (page) => until(page, "the camera's red", async () => (await pixels(page, 255, 0, 0)) > 100_000),
  "occupancygrid.html": async (page, watcher) => {
    await until(page, "the robot's orange", async () => (await pixels(page, 255, 171, 87)) > 30);
    const heard = hears(watcher, "/pr2_move_base/goal", "move_base_msgs/MoveBaseActionGoal", "msg.goal.target_pose");
    await page.bringToFront();
    await page.waitForTimeout(1000);
    await page.locator("canvas").dblclick({ position: { x: 150, y: 300 } });
    const { goal } = await heard;
    if (goal.target_pose.header.frame_id !== "map") throw new Error(`a goal in ${goal.target_pose.header.frame_id}`);
  },
};

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-dev-shm-usage"],
});
let failed = 0;
for (const name of pages) {
  const context = await browser.newContext();
  const [page, watcher] = [await context.newPage(), await context.newPage()];
  const said = [];
  page.on("pageerror", ({ message }) => said.push(message));
  try {
    await watcher.goto(`${site}watcher`);
    await page.goto(`${site}${name}`, { waitUntil: "domcontentloaded" });
    await VISITS[name.replace(/^.*\//, "")](page, watcher);
    console.log(`passed ${name}${said.length ? ` (the page says: ${said.join("; ")})` : ""}`);
  } catch (error) {
    failed++;
    console.log(`failed ${name}: ${error.message.split("\n")[0]}${said.length ? ` (${said.join("; ")})` : ""}`);
  }
  await context.close();
}
await browser.close();
server.close();
console.log(`${pages.length - failed} of ${pages.length} pages did what they are for`);
process.exitCode = failed ? 1 : 0;
