"""Compare the dashboard with Lichtblick and Vizanti: the same scene of the same robot, in images and figures.

    make compare-dashboards LICHTBLICK=lichtblick/web/.webpack VIZANTI=vizanti

Lichtblick (MPL-2.0): clone github.com/lichtblick-suite/lichtblick, `git checkout 66adecb`, then
`corepack yarn install`, `corepack yarn build:packages`, `corepack yarn web:build:prod`.
Vizanti (BSD): clone github.com/MoffKalast/vizanti, `git checkout 190c584` (branch ros2).

The demo robot creeps to a goal. Lichtblick connects by Foxglove's protocol, Vizanti by rosbridge. Both are
served from files, compressed with gzip; a relay replaces Vizanti's node for transforms. Each page is loaded
with an empty cache. Processor time is that of all processes of Chromium, which renders WebGL in software.
Needs Linux.
"""

from __future__ import annotations

import argparse
import base64
import gzip
import io
import json
import mimetypes
import os
import re
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Final

import anyio
from PIL import Image, ImageStat

from rwt import Server
from rwt_participant.messages import Message
from tests.browser.driver import NODE, Kind, Page, find_browser, opened_browser

DESKTOP: Final = (1440, 900)
PHONE: Final = (390, 844)
SETTLE_S: Final = 10.0
MOST_BYTES: Final = 150_000
"""Limit of the size of an image file."""
IMAGE_CONTRAST: Final = 15.0
"""Standard deviation of grey values from which an image of the camera is shown, and not a blank panel."""

TAB: Final = (
    "[...document.querySelectorAll('[role=tab]')]"
    ".filter((tab) => tab.textContent.includes('{}')).map((tab) => tab.click()).length"
)
"""Expression that opens a tab, and is true if the tab exists."""
TRANSFERS: Final = (
    "performance.getEntriesByType('navigation').concat(performance.getEntriesByType('resource'))"
    ".filter((each) => each.name.startsWith(location.origin)).map((each) => each.transferSize)"
)
"""Expression with the bytes of each file that the page has loaded."""

Response = bytes | None
"""Content that a program's own server generates; None for a file."""

LAYOUTS: Final = json.loads(Path(__file__).with_name("compared_layouts.json").read_text("utf-8"))
"""Layout of Lichtblick and settings of Vizanti, in their formats, with the panels that show the scene."""


@dataclass(frozen=True, slots=True)
class Dashboard:
    """A page that is compared.

    Attributes:
        name: name of its image files.
        url: URL of the page.
        size: width and height of the window, in pixels.
        themes: colour schemes that the page has.
        image: JavaScript expression with the element that shows the camera.
        tab: text of a tab to open first.
    """

    name: str
    url: str
    size: tuple[int, int]
    themes: tuple[str, ...]
    image: str
    tab: str = ""


@contextmanager
def served(folder: Path, generated: Callable[[str], Response]) -> Iterator[str]:
    """Serve a folder, compressed, and generated content; yields the URL."""

    @cache
    def body(path: str) -> bytes | None:
        content = generated(path)
        file = folder / path.lstrip("/")
        if content is None and file.is_file():
            content = file.read_bytes()
        return None if content is None else gzip.compress(content, 6)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = self.path.partition("?")[0]
            content = body(path)
            self.send_response(404 if content is None else 200)
            script = "text/html" if path == "/" else "text/javascript"
            self.send_header("Content-Type", mimetypes.guess_type(path)[0] or script)
            self.send_header("Content-Encoding", "gzip")
            self.send_header("Content-Length", str(len(content or b"")))
            self.end_headers()
            self.wfile.write(content or b"")

        def log_request(self, code: object = "-", size: object = "-") -> None:
            """Print no requests."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


def lichtblick_content(folder: Path, path: str) -> Response:
    """Return Lichtblick's start page with our layout in the place that it has for one."""
    page = (folder / "index.html").read_text(encoding="utf-8")
    place = "/*LICHTBLICK_SUITE_DEFAULT_LAYOUT_PLACEHOLDER*/"
    return page.replace(place, json.dumps(LAYOUTS["lichtblick"])).encode() if path == "/" else None


def vizanti_content(public: Path, port: int, path: str) -> Response:
    """Return what Vizanti's own server, a ROS node, generates."""
    templates, models = public / "templates", public / "assets" / "robot_model"

    def module(value: object) -> bytes:
        return f"export default {json.dumps(value)};".encode()

    match path:
        case "/":
            page = (public / "index.html").read_text(encoding="utf-8")
            page = re.sub(
                r'{% include "(.*?)" %}', lambda found: (public / found[1]).read_text("utf-8"), page
            )
            page = re.sub(r"{{ url_for\('serve_static', path='(.*?)'\) }}", r"/\1", page)
            return page.replace("{{ base_url }}", "").encode()
        case "/ros_launch_params":
            return module({"port": 0, "port_rosbridge": port, "compression": "none"})
        case "/default_widget_config":
            return module(json.dumps(LAYOUTS["vizanti"]))
        case "/templates/files":
            files = [file for file in templates.rglob("*") if file.suffix in (".html", ".js", ".css")]
            texts = {str(file.relative_to(templates)): file.read_text("utf-8") for file in files}
            return module([{"path": name, "content": text} for name, text in texts.items()])
        case "/assets/robot_model/paths":
            return module([file.name for file in models.glob("*.png")])
    return None


@asynccontextmanager
async def robot() -> AsyncIterator[str]:
    """Serve the demo robot on its way to a goal; yields the URL of its dashboard."""
    async with Server("ws://127.0.0.1:0", demo=True, origins={"allow": ["*"]}) as server:
        node = server.node("compared")
        frames = node.advertise("/vizanti/tf_consolidated", "tf2_msgs/TFMessage")
        node.subscribe("/tf", frames.publish, "tf2_msgs/TFMessage")
        planned: list[Message] = []
        arrived = anyio.Event()

        def keep(plan: Message) -> None:
            planned.append(plan)
            arrived.set()

        with node.subscribe("/plan", keep, "nav_msgs/Path"):
            await node.params.set("/demo_robot:max_speed", 0.005)
            pose = {"position": {"x": 3.0, "y": 2.0}, "orientation": {"w": 1.0}}
            goal = {"pose": {"header": {"frame_id": "map"}, "pose": pose}}
            await node.send_goal("/navigate_to_pose", goal)
            await arrived.wait()
        # Pages that are opened later show the path, too.
        path = node.advertise("/plan", "nav_msgs/Path")
        node.create_timer(1.0, lambda: path.publish(planned[0]))
        yield server.urls[0].replace("ws", "http", 1) + "/"


def processor_seconds() -> float:
    """Return the processor time of the processes that this one started, in seconds."""
    found, ticks = [os.getpid()], 0
    for pid in found:
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += map(int, (task / "children").read_text().split())
        # Behind the name, which may contain blanks, user and system time are fields 12 and 13.
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        ticks += 0 if pid == os.getpid() else int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


async def first_image(page: Page, element: str) -> float:
    """Wait until an element shows an image; returns the seconds since the navigation."""
    while True:
        box = await page.evaluate(f"({element})?.getBoundingClientRect().toJSON()")
        if box and box["width"] > 20 and box["height"] > 20:
            clip = {name: box[name] for name in ("x", "y", "width", "height")} | {"scale": 0.25}
            shot = await page.inspect("Page.captureScreenshot", clip=clip)
            with Image.open(io.BytesIO(base64.b64decode(shot["data"]))) as image:
                if ImageStat.Stat(image.convert("L")).stddev[0] > IMAGE_CONTRAST:
                    return float(await page.evaluate("performance.now()")) / 1000
        await anyio.sleep(0.1)


def save(picture: Path, path: Path) -> None:
    """Save a screenshot as WebP, in the best quality that the limit allows."""
    with Image.open(picture) as image:
        for quality in range(90, 20, -10):
            image.convert("RGB").save(path, quality=quality, method=6)
            if path.stat().st_size <= MOST_BYTES:
                return


async def show(kind: Kind, shown: Dashboard, seconds: float, out: Path) -> None:
    """Load a page with an empty cache, print its figures, and save its images."""
    with tempfile.TemporaryDirectory() as folder, opened_browser(kind, Path(folder)) as browser:
        async with browser.page("about:blank", *shown.size) as page:
            page.forgive("")  # A comparison is no test of these pages.
            for theme in shown.themes:
                scheme = {"name": "prefers-color-scheme", "value": theme}
                await page.inspect("Emulation.setEmulatedMedia", features=[scheme])
                await page.goto(shown.url)
                if shown.tab:
                    await page.wait(TAB.format(shown.tab))
                image_s = await first_image(page, shown.image)
                await anyio.sleep(SETTLE_S)
                save((await page.picture(f"compared {shown.name}")).path, out / f"{shown.name}-{theme}.webp")
                if theme != shown.themes[0]:
                    continue
                sizes = await page.evaluate(TRANSFERS)
                spent, began = processor_seconds(), time.monotonic()
                await anyio.sleep(seconds)
                cores = (processor_seconds() - spent) / (time.monotonic() - began)
                print(
                    f"{shown.name:16} {sum(sizes) / 1000:8.0f} kB {len(sizes):4} requests"
                    f"  image after {image_s:5.1f} s  {cores:5.2f} cores",
                    flush=True,
                )


async def compare(kind: Kind, lichtblick: Path, public: Path, seconds: float, out: Path) -> None:
    """Show all dashboards, one after the other, with the same robot."""
    async with robot() as url:
        port = int(url.rstrip("/").rpartition(":")[2])
        with (
            served(lichtblick, partial(lichtblick_content, lichtblick)) as theirs,
            served(public, partial(vizanti_content, public, port)) as vizanti,
        ):
            socket = f"ws://127.0.0.1:{port}"
            both = ("dark", "light")
            ours, right = (
                "document.querySelector('.panel-camera canvas, .panel-camera img')",
                ("[...document.querySelectorAll('canvas')].find((it) => it.getBoundingClientRect().x > 880)"),
            )
            camera = "document.getElementById('compressedimage_image')"
            for each in (
                Dashboard("ours", url, DESKTOP, both, ours),
                Dashboard(
                    "lichtblick", f"{theirs}?ds=foxglove-websocket&ds.url={socket}", DESKTOP, both, right
                ),
                Dashboard(
                    "ours-phone",
                    url,
                    PHONE,
                    ("dark",),
                    "document.querySelector('.panel-teleop canvas')",
                    "Drive",
                ),
                Dashboard("vizanti-phone", vizanti, PHONE, ("dark",), camera),
            ):
                await show(kind, each, seconds, out)


def main() -> int:
    """Compare, and write the images."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.compare_dashboards",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--lichtblick", type=Path, required=True, help="folder of the built page")
    parser.add_argument("--vizanti", type=Path, required=True, help="folder of the clone")
    parser.add_argument("--out", type=Path, required=True, help="folder for the images")
    parser.add_argument("--seconds", type=float, default=30.0, help="measured time per page (default 30)")
    given = parser.parse_args()
    public = given.vizanti / "vizanti_server" / "public"
    for needed in (given.lichtblick / "index.html", public / "index.html"):
        if not needed.is_file():
            parser.error(f"{needed} does not exist: get the two programs as stated in --help")
    kind = find_browser()
    if kind is None or kind.driver.parent != NODE:
        parser.error("Chromium is not installed: `apt-get install chromium` on Debian")
    given.out.mkdir(parents=True, exist_ok=True)
    # Without Playwright, which repeats each message of each WebSocket.
    kind = replace(kind, driver=NODE / "bare.mjs")
    anyio.run(compare, kind, given.lichtblick, public, given.seconds, given.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
