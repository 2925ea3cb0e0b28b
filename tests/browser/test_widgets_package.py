"""The elements as an npm package: installed, checked by TypeScript, bundled, and shown."""

from __future__ import annotations

import functools
import http.server
import json
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import pytest

from rwt import Server
from tests.browser.driver import NODE, Browser
from tests.browser.stand import REGISTRIES
from tests.docs.blocks import ROOT

pytestmark = pytest.mark.anyio

TYPESCRIPT = ROOT / "tests" / "clients" / "node" / "node_modules" / "typescript" / "lib" / "tsc.js"
PUBLINT = ROOT / "web" / "node_modules" / "publint" / "src" / "cli.js"
ESBUILD = NODE / "node_modules" / ".bin" / "esbuild"

PROGRAM = """\
import { StopElement } from "@robot-web-tools/widgets";

const robot = new URLSearchParams(location.search).get("robot") ?? "";
const stop = document.createElement("rwt-stop");
const battery = document.createElement("rwt-battery");
const teleop = document.createElement("rwt-teleop");
for (const element of [stop, battery, teleop]) {
  element.robot = robot;
  document.body.append(element);
}
battery.low = 30;
teleop.keys = "page";
teleop.addEventListener("rwt-drive", ({ detail }) => console.log(detail.linear.toFixed(2)));
document.body.addEventListener("rwt-stop", (event) => {
  document.title = event.target instanceof StopElement && event.target.stopped ? "stopped" : "no";
});
"""

#: What TypeScript must find: a value of the wrong type, a word that is none, an event without such a member.
MISTAKES = {
    "battery.low = 30;": 'battery.low = "30";',
    'teleop.keys = "page";': 'teleop.keys = "pages";',
    "detail.linear.toFixed(2)": "detail.speed.toFixed(2)",
}


#: The same in TSX, as React's users write it.
TSX = """\
import type {} from "@robot-web-tools/widgets/react";

export const page = (
  <main>
    <rwt-video topic="/camera/image_raw" />
    <rwt-stop robot="ws://127.0.0.1:9090" onrwt-stop={(event) => console.log(event.bubbles)} />
    <rwt-teleop keys="page" onrwt-drive={({ detail }) => console.log(detail.linear.toFixed(2))} />
    <rwt-scene />
    <rwt-map />
    <rwt-plot />
    <rwt-topic />
    <rwt-battery low={30} />
  </main>
);
"""
TSX_MISTAKES = {
    "low={30}": 'low="30"',
    'keys="page"': 'keys="pages"',
    "detail.linear.toFixed(2)": "detail.speed.toFixed(2)",
    "<rwt-scene />": "<rwt-scenes />",
}


def run(*command: object, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(each) for each in command], cwd=folder, capture_output=True, text=True)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of somebody's, with the package installed in it from its file and nothing else."""
    folder = tmp_path_factory.mktemp("project")
    widgets = folder / "widgets"
    steps: list[tuple[object, ...]] = [
        ("node", ROOT / "web" / "package_widgets.mjs", widgets),
        ("node", PUBLINT, "--strict", widgets),
        ("npm", "pack", "--silent", "--pack-destination", folder, widgets),
    ]
    for step in steps:
        done = run(*step, folder=folder)
        assert done.returncode == 0, done.stdout + done.stderr
    shutil.rmtree(widgets)
    (folder / "package.json").write_text(json.dumps({"private": True, "type": "module"}))
    (packed,) = folder.glob("*.tgz")
    done = run("npm", "install", "--offline", "--no-audit", "--no-fund", packed, folder=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def typescript(program: str, folder: Path, file: str = "page.ts") -> subprocess.CompletedProcess[str]:
    (folder / file).write_text(program)
    options = [
        "--noEmit",
        "--strict",
        "--target",
        "es2022",
        "--module",
        "nodenext",
        "--lib",
        "es2023,dom,dom.iterable",
        "--jsx",
        "react-jsx",
    ]
    return run("node", TYPESCRIPT, *options, file, folder=folder)


def test_a_program_is_checked_and_its_mistakes_are_found(project: Path) -> None:
    done = typescript(PROGRAM, project)
    assert done.returncode == 0, done.stdout
    wrong = PROGRAM
    for before, after in MISTAKES.items():
        assert before in wrong
        wrong = wrong.replace(before, after)
    assert typescript(wrong, project).stdout.count(": error ") == len(MISTAKES)


def test_the_elements_are_known_in_tsx(project: Path) -> None:
    for name in ("@types/react", "csstype"):
        place = project / "node_modules" / name
        place.parent.mkdir(exist_ok=True)
        place.symlink_to(ROOT / "web" / "node_modules" / name)
    done = typescript(TSX, project, "page.tsx")
    assert done.returncode == 0, done.stdout
    wrong = TSX
    for before, after in TSX_MISTAKES.items():
        assert before in wrong
        wrong = wrong.replace(before, after)
    assert typescript(wrong, project, "page.tsx").stdout.count(": error ") == len(TSX_MISTAKES)


@contextmanager
def served(folder: Path) -> Iterator[str]:
    handler = functools.partial(_Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name in http.server
        """Say nothing: the test does."""


async def test_a_bundled_page_shows_a_robot_elsewhere_and_stops_it(project: Path, browser: Browser) -> None:
    (project / "page.ts").write_text(PROGRAM)
    out = project / "out"
    done = run(
        ESBUILD, "page.ts", "--bundle", "--splitting", "--format=esm", f"--outdir={out}", folder=project
    )
    assert done.returncode == 0, done.stderr
    (out / "index.html").write_text(
        "<!doctype html><title>-</title><body><script type=module src=page.js></script>"
    )
    async with Server("ws://127.0.0.1:0", registry=REGISTRIES["jazzy"], demo=True) as server:
        with served(out) as address:
            url = f"{address}/index.html?robot={quote(server.urls[0])}"
            async with browser.page(url, 600, 600) as page:
                await page.wait("document.querySelector('rwt-battery')?.shadowRoot?.querySelector('meter')")
                await page.wait("document.querySelector('rwt-teleop')?.shadowRoot?.querySelector('button')")
                await page.evaluate("document.querySelector('rwt-stop').stop()")
                await page.wait("document.title === 'stopped'")
