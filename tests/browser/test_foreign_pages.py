"""Images of a robot on pages of other servers: shown where the page may connect, and else refused."""

from __future__ import annotations

import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Final

import pytest

from rwt import Server
from tests.browser.driver import HERE, Browser, Picture, near
from tests.browser.stand import REGISTRIES
from tests.browser.test_libraries import BLUE, RED, plain, port_of
from tests.docs.processes import Running, commands_folder
from tests.processes import free_port

pytestmark = pytest.mark.anyio

_PAGE: Final = """<!doctype html>
<meta charset="utf-8">{head}
<style>body {{ margin: 0; background: rgb(0, 0, 255) }} img {{ display: block }}</style>
<img src="http://127.0.0.1:{port}/{image}" width="64" height="48"
  onload="shown = true" onerror="refused = true">
<script>var shown = false, refused = false;</script>
"""

_STREAM: Final = "stream?topic=/wide_stereo/left/image_color"
_SNAPSHOT: Final = "snapshot?topic=/wide_stereo/left/image_color"
_SECRETIVE: Final = '<meta name="referrer" content="no-referrer">'


@contextmanager
def site(folder: Path, name: str, text: str) -> Iterator[int]:
    """Port of a plain web server with one page; it has two names, `127.0.0.1` and `localhost`."""
    (folder / name).write_text(text, encoding="utf-8")
    port = free_port()
    command = [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1"]
    with Running(command, folder, commands_folder(folder / "commands")) as server:
        server.wait_for_port(port)
        yield port


@asynccontextmanager
async def robot(*allow: str) -> AsyncIterator[Server]:
    """Server with a camera, for which a page of `localhost` is foreign: it is addressed as `127.0.0.1`."""
    async with Server("ws://0.0.0.0:0", registry=REGISTRIES["jazzy"], origins={"allow": [*allow]}) as server:
        node = server.node("test")
        camera = node.advertise("/wide_stereo/left/image_color", "sensor_msgs/Image")
        other = node.advertise("/l_forearm_cam/image_color", "sensor_msgs/Image")
        node.create_timer(0.1, lambda: camera.publish(plain(RED)))
        node.create_timer(0.1, lambda: other.publish(plain(RED)))
        yield server


@pytest.mark.parametrize("image", [_STREAM, _SNAPSHOT])
@pytest.mark.parametrize(
    ("host", "head", "allow", "shown"),
    [
        ("127.0.0.1", "", (), True),  # another port of the same host
        ("127.0.0.1", _SECRETIVE, (), False),  # the browser does not show it: addresses are no site
        ("localhost", "", (), False),
        ("localhost", _SECRETIVE, (), False),
        ("localhost", "", ("http://localhost:*",), True),
        ("localhost", _SECRETIVE, ("http://localhost:*",), False),
    ],
)
async def test_an_image_on_a_page_of_another_server(
    browser: Browser, tmp_path: Path, image: str, host: str, head: str, allow: tuple[str, ...], shown: bool
) -> None:
    async with robot(*allow) as server:
        text = _PAGE.format(port=port_of(server), image=image, head=head)
        with site(tmp_path, "page.html", text) as port:
            async with browser.page(f"http://{host}:{port}/page.html", 200, 100) as page:
                page.forgive("403", "ERR_BLOCKED_BY_RESPONSE")
                if shown:
                    await page.picture_when("foreign page", lambda seen: near(seen.at(32, 24), RED))
                else:
                    await page.wait("refused")
                    assert await page.evaluate("shown") is False
                    assert near((await page.picture("foreign page")).at(32, 24), BLUE)


@pytest.mark.parametrize(("allow", "is_shown"), [((), False), (("http://localhost:*",), True)])
async def test_mjpegcanvas_on_a_foreign_page(
    browser: Browser, tmp_path: Path, allow: tuple[str, ...], is_shown: bool
) -> None:
    def shows(seen: Picture) -> bool:
        return near(seen.at(160, 120), RED)

    async with robot(*allow) as server:
        text = (HERE / "pages" / "dropin" / "mjpegcanvas.html").read_text(encoding="utf-8")
        text = text.replace("9090", str(port_of(server)))
        with site(tmp_path, "page.html", text) as port:
            async with browser.page(f"http://localhost:{port}/page.html", 400, 520) as page:
                page.forgive("403")
                if is_shown:
                    await page.picture_when("mjpegcanvas on a foreign page", shows)
                    return
                # The library, which reveals nothing, has loaded; it draws its complaint instead of a camera.
                await page.wait("viewer.image.complete && !viewer.image.naturalWidth")
                assert not shows(await page.picture("mjpegcanvas on a foreign page"))


async def test_a_link_to_a_page_of_the_robot_opens_it(browser: Browser, tmp_path: Path) -> None:
    async with robot() as server:
        link = f'<a href="http://127.0.0.1:{port_of(server)}/index" style="display: block">the robot</a>'
        with site(tmp_path, "page.html", f"<!doctype html>{link}") as port:
            async with browser.page(f"http://localhost:{port}/page.html", 400, 300) as page:
                await page.click("a")
                await page.wait("document.body.innerText.includes('/wide_stereo/left')")
