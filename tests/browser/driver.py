"""The browser process, its pages, and pictures of them."""

from __future__ import annotations

import itertools
import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, TypedDict

import anyio.to_thread
import numpy as np
from PIL import Image

HERE = Path(__file__).parent
NODE = HERE / "node"
#: Screenshots of the last run, for people to look at.
SCREENSHOTS = HERE / "screenshots"

#: Seconds until a page shows what it should; on a busy machine without a graphics card that may take a while.
PATIENCE = 60.0
#: What Firefox says of a WebSocket that is refused, and of a mesh whose page is left while it loads.
REFUSED = "establish a connection to the server"
LEFT_MESH = "Error loading mesh"
LEFT_STREAM = "Error in input stream"
#: Seconds that a command may take beyond that.
_SLACK = 8.0

#: Firefox's sound goes by a sound card's clock; `make firefox` gives one where PulseAudio is installed.
IS_MUTE = os.environ.get("BROWSER") == "firefox" and "PULSE_SERVER" not in os.environ
MUTE = "Firefox has no sound without a sound card: use `make firefox`, with pulseaudio installed"

_KINDS = {
    "chromium": (NODE / "chromium.mjs", ("chromium", "chromium-browser", "google-chrome")),
    "firefox": (HERE / "firefox" / "firefox.mjs", ("firefox", "firefox-esr")),
}


class Size(TypedDict):
    """Of a page, in its own pixels."""

    width: int
    height: int


Pixels = Any
"""A numpy array of height, width and the three colours."""


@dataclass(frozen=True)
class Kind:
    """A browser that the tests know.

    Attributes:
        driver: the module that drives it.
        program: what is run.
    """

    driver: Path
    program: str


def find_browser() -> Kind | None:
    """The browser that the environment variable BROWSER names, ``chromium`` by default, or ``firefox``.

    Its program is what the variable CHROMIUM or FIREFOX says, or the first that is installed.
    """
    wanted = os.environ.get("BROWSER", "chromium")
    driver, names = _KINDS[wanted]
    program = os.environ.get(wanted.upper()) or next(filter(None, map(shutil.which, names)), None)
    return Kind(driver, program) if program else None


@contextmanager
def opened_browser(kind: Kind, folder: Path) -> Iterator[Browser]:
    """A browser within the block; what it needs, and its log, is written to `folder`."""
    with (folder / "browser.log").open("wb") as log:
        browser = Browser(kind, folder, log)
        try:
            yield browser
        finally:
            browser.close()


class Browser:
    """One browser, driven by lines of JSON."""

    def __init__(self, kind: Kind, folder: Path, log: IO[bytes]) -> None:
        self.built = folder
        self._log = Path(log.name)
        self._process = subprocess.Popen(
            ["node", str(NODE / "browser.mjs"), str(kind.driver), kind.program, str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._numbers = itertools.count(1)
        self.version = str(self._answer(60.0, None))

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put(None)

    def _answer(self, seconds: float, number: int | None) -> Any:
        while True:
            try:
                line = self._lines.get(timeout=seconds)
            except queue.Empty:
                raise AssertionError(
                    f"the browser says nothing for {seconds:g} s:\n{self._errors()}"
                ) from None
            if line is None:
                raise AssertionError(f"the browser ended:\n{self._errors()}")
            answer = json.loads(line)
            if answer.get("number") != number:
                continue  # It comes too late: whoever asked has given up.
            if "failed" in answer:
                raise AssertionError(f"the browser: {answer['failed']}")
            return answer["answer"]

    def _errors(self) -> str:
        return self._log.read_text(errors="replace")[-4000:]

    def _ask(self, command: str, arguments: dict[str, object]) -> Any:
        assert self._process.stdin is not None
        number = next(self._numbers)
        self._process.stdin.write(json.dumps({"command": command, "number": number, **arguments}) + "\n")
        self._process.stdin.flush()
        return self._answer(PATIENCE + _SLACK, number)

    async def ask(self, command: str, **arguments: object) -> Any:
        """Have one command done."""
        return await anyio.to_thread.run_sync(self._ask, command, arguments)

    @asynccontextmanager
    async def page(
        self, url: str, width: int = 500, height: int = 400, *, language: str = "en-GB"
    ) -> AsyncIterator[Page]:
        """A page of its own, for a person who speaks a language. An error on its console fails the test when
        the page is closed."""
        name = f"page {next(self._numbers)}"
        await self.ask("open", page=name, url=url, width=width, height=height, locale=language)
        page = Page(self, name)
        try:
            yield page
        except BaseException:
            with anyio.CancelScope(shield=True):
                sys.stderr.write(await page.report())
                await page.picture(f"failed {name}")
                await self.ask("close", page=name)
            raise
        complaints = await page.complaints()
        await self.ask("close", page=name)
        if complaints:
            raise AssertionError("the page complains:\n" + "\n".join(complaints))

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """Stop all processes of the browser within the block, as a suspended computer does."""
        stopped = _with_descendants(self._process.pid)
        for pid in stopped:
            os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            for pid in reversed(stopped):
                os.kill(pid, signal.SIGCONT)

    def renderer_bytes(self) -> int:
        """Return the resident memory of the processes that run pages; Linux only."""
        total = 0
        for pid in _with_descendants(self._process.pid):
            folder = Path(f"/proc/{pid}")
            if b"--type=renderer" in (folder / "cmdline").read_bytes():
                total += int((folder / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        return total

    def close(self) -> None:
        """End the browser."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        try:
            self._process.wait(timeout=15)
        finally:
            self._process.kill()
            self._process.wait()
            self._reader.join()
            self._process.stdout.close()


def _with_descendants(pid: int) -> list[int]:
    """Return a process and all that it has started, parents first; Linux only."""
    found = [pid]
    for each in found:
        for task in Path(f"/proc/{each}/task").iterdir():
            found += map(int, (task / "children").read_text().split())
    return found


class Page:
    """One page of the browser."""

    def __init__(self, browser: Browser, name: str) -> None:
        self._browser = browser
        self._name = name
        self._forgiven: list[str] = []

    async def _ask(self, command: str, **arguments: object) -> Any:
        return await self._browser.ask(command, page=self._name, **arguments)

    async def evaluate(self, script: str) -> Any:
        """The value of a JavaScript expression."""
        return await self._ask("evaluate", script=script)

    async def goto(self, url: str) -> None:
        """Open another address in the page, and wait until it has loaded."""
        await self._ask("goto", url=url)

    async def wait(self, script: str) -> Any:
        """Wait until an expression is true."""
        return await self._ask("wait", script=script, timeout=PATIENCE * 1000)

    async def calm(self) -> None:
        """Wait until the page's thread has not been blocked for a second, at most for twenty.

        A page that was blocked for half a second lets go of every control that drives the robot.
        """
        await self.evaluate(
            """new Promise((resolve) => {
              let last = performance.now();
              let since = last;
              const end = last + 20_000;
              const timer = setInterval(() => {
                const now = performance.now();
                if (now - last > 200) since = now;
                last = now;
                if (now - since > 1000 || now > end) resolve(clearInterval(timer) ?? true);
              }, 20);
            })"""
        )

    async def inspect(self, method: str, **params: object) -> Any:
        """Ask Chromium itself, by its DevTools protocol."""
        return await self._ask("inspect", method=method, params=params)

    async def trace(self, seconds: float) -> Path:
        """Record a trace of Chromium for so many seconds, less than a minute, in a file."""
        path = self._browser.built / "trace.json"
        await self._ask("trace", seconds=seconds, path=str(path))
        return path

    async def complaints(self) -> list[str]:
        """Errors on its console and exceptions so far, but for those that are expected."""
        said = await self._ask("complaints")
        return [each for each in said if not any(part in each for part in self._forgiven)]

    async def report(self) -> str:
        """Return the log of the page and its pending waits, to explain a failed test."""
        return f"{self._name}: {await self._ask('report')}\n"

    def forgive(self, *parts: str) -> None:
        """Expect complaints with any of these parts, which the test itself has brought about."""
        self._forgiven += parts

    async def picture(self, name: str) -> Picture:
        """Take a screenshot of the page, kept as a file of that name."""
        SCREENSHOTS.mkdir(exist_ok=True)
        path = SCREENSHOTS / f"{name}.png"
        await self._ask("screenshot", path=str(path))
        return Picture(path)

    async def pixel(self, x: float, y: float, z: float = 0.0) -> tuple[int, int]:
        """Where the scene page draws a point of its fixed frame."""
        across, down = await self.evaluate(f"pixel({x}, {y}, {z})")
        return round(across), round(down)

    async def mouse(self, action: str, *args: object) -> None:
        """`move x y`, `down`, `up` and so on."""
        await self._ask("mouse", action=action, args=args)

    async def keyboard(self, action: str, key: str) -> None:
        """`down`, `up` or `press` a key."""
        await self._ask("keyboard", action=action, args=[key])

    async def click(self, selector: str) -> None:
        """Click an element."""
        await self._ask("click", selector=selector)

    async def drag(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Press the mouse at one place, let it go at another and leave: ros3d lights up what is under it."""
        await self.mouse("move", *start)
        await self.mouse("down")
        await self.mouse("move", *end, {"steps": 8})
        await self.mouse("up")
        await self.mouse("move", 2, 2)

    async def picture_when(self, name: str, is_right: Any) -> Picture:
        """A picture once `is_right(picture)` holds; what the page shows comes over the network."""
        with anyio.move_on_after(PATIENCE):
            while True:
                picture = await self.picture(name)
                if is_right(picture):
                    return picture
                await anyio.sleep(0.05)
        raise AssertionError(f"the page does not come to look as it should: see {SCREENSHOTS / name}.png")


class Picture:
    """A screenshot.

    Attributes:
        path: of the PNG file.
        pixels: red, green and blue by row and column.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with Image.open(path) as image:
            self.pixels: Pixels = np.asarray(image.convert("RGB")).astype(int)

    def at(self, x: float, y: float, around: int = 1) -> tuple[int, int, int]:
        """The median colour of a small square."""
        column, row = round(x), round(y)
        square = self.pixels[
            max(0, row - around) : row + around + 1, max(0, column - around) : column + around + 1
        ]
        red, green, blue = np.median(square.reshape(-1, 3), axis=0)
        return int(red), int(green), int(blue)

    def mask(self, colour: tuple[int, int, int], tolerance: int = 40) -> Pixels:
        """Which pixels have about that colour."""
        return (np.abs(self.pixels - np.array(colour)) <= tolerance).all(axis=2)

    def count(self, colour: tuple[int, int, int], tolerance: int = 40) -> int:
        """Return the number of pixels of about that colour."""
        return int(self.mask(colour, tolerance).sum())

    def centre(self, colour: tuple[int, int, int], tolerance: int = 40) -> tuple[float, float]:
        """The middle of all pixels of about that colour, x and y."""
        rows, columns = np.nonzero(self.mask(colour, tolerance))
        assert len(rows), f"{self.path}: nothing is {colour}"
        return float(columns.mean()), float(rows.mean())


def near(colour: tuple[int, int, int], expected: tuple[int, int, int], tolerance: int = 40) -> bool:
    """Return True if two colours look the same."""
    return all(abs(a - b) <= tolerance for a, b in zip(colour, expected, strict=True))
