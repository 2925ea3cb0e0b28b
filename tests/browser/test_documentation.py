"""The pages of the documentation that a browser opens, as their readers do."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.browser.driver import NODE, Browser, Picture
from tests.docs.blocks import ALL_BLOCKS, Block
from tests.docs.processes import Running, commands_folder
from tests.processes import free_port

pytestmark = pytest.mark.anyio

_PAGES = [block for block in ALL_BLOCKS if block.value("run") == "browser"]
_SEES = re.compile(r"(\d+) of #([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})")


def looks_right(picture: Picture, block: Block) -> bool:
    """Return True if it has all the colours that the block says."""
    for line in block.values("sees"):
        found = _SEES.fullmatch(line)
        assert found, f"{block.name}: expected `sees: N of #rrggbb`, got {line!r}"
        colour = int(found[2], 16), int(found[3], 16), int(found[4], 16)
        if picture.count(colour, 45) < int(found[1]):
            return False
    return True


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of somebody who has installed the libraries."""
    packages = tmp_path / "node_modules"
    packages.mkdir()
    for name, installed in {"roslib": "roslib1", "ros3d": "ros3d"}.items():
        (packages / name).symlink_to(NODE / "node_modules" / installed)
    return tmp_path


@pytest.fixture
def web_server(folder: Path) -> Iterator[int]:
    """The port of a plain web server for that folder."""
    port = free_port()
    with Running(
        [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1"],
        folder,
        commands_folder(folder / "commands"),
    ) as server:
        server.wait_for_port(port)
        yield port


@pytest.mark.parametrize("block", _PAGES, ids=[block.name for block in _PAGES])
async def test_a_page_of_the_documentation(
    block: Block, browser: Browser, folder: Path, web_server: int
) -> None:
    assert block.values("sees"), f"{block.name}: a page that nobody looks at proves nothing"
    port = free_port()
    name = block.value("file")
    (folder / name).write_text(block.code.replace("9090", str(port)), encoding="utf-8")
    command = [sys.executable, "-m", "rwt.cli", "serve", "--demo", f"ws://127.0.0.1:{port}"]
    with Running(command, folder, folder / "commands") as server:
        server.wait_for_port(port)
        async with browser.page(f"http://127.0.0.1:{web_server}/{name}", 640, 420) as page:
            await page.picture_when(f"documentation {name}", lambda seen: looks_right(seen, block))
        server.expect_no_complaint()
