"""The page on a transport of one's own, followed word by word: its programs at both ends of a serial line."""

from __future__ import annotations

import os
import selectors
import sys
import threading
import tty
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT, blocks_of
from tests.docs.processes import Running, commands_folder
from tests.processes import free_port

PAGE = ROOT / "docs" / "how-to" / "own-transport.md"


@pytest.fixture
def cable() -> Iterator[list[str]]:
    """Two serial lines whose far ends are joined: what is written to one comes out of the other."""
    with ExitStack() as stack:
        masters, paths = [], []
        for _ in range(2):
            master, slave = os.openpty()
            stack.callback(os.close, master)
            stack.callback(os.close, slave)
            tty.setraw(slave)
            masters.append(master)
            paths.append(os.ttyname(slave))
        stopped, stop = os.pipe()
        stack.callback(os.close, stopped)
        joined = threading.Thread(target=_join, args=(*masters, stopped))
        joined.start()
        stack.callback(joined.join)
        stack.callback(os.close, stop)
        yield paths


def _join(one: int, other: int, stopped: int) -> None:
    """Carry bytes both ways until the other end of `stopped` is closed."""
    with selectors.DefaultSelector() as ready:
        for source, target in ((one, other), (other, one), (stopped, None)):
            ready.register(source, selectors.EVENT_READ, target)
        while True:
            for key, _ in ready.select():
                if key.data is None:
                    return
                os.write(key.data, os.read(key.fd, 4096))


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder with the files that the page shows."""
    port = str(free_port())
    for block in blocks_of(PAGE):
        if name := block.value("file"):
            (tmp_path / name).write_text(block.code.replace("9090", port), encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("server", "failed"),
    [
        ("server.py", "failed: call_service: no service /nothing"),
        ("bridge.py", "failed: Service /nothing does not exist"),
    ],
)
def test_a_client_and_a_server_talk_over_a_serial_line(
    server: str, failed: str, cable: list[str], programs: Path, tmp_path: Path
) -> None:
    commands = commands_folder(tmp_path / "commands")
    with (
        Running([sys.executable, server, cable[0]], programs, commands),
        Running([sys.executable, "client.py", cable[1]], programs, commands) as client,
    ):
        for line in ("heard: over a wire", "sum: 3", failed):
            client.wait_for(line)
        client.expect_end()


@pytest.mark.parametrize("name", ["server.py", "client.py"])
def test_a_side_takes_about_forty_lines(name: str) -> None:
    (block,) = [block for block in blocks_of(PAGE) if block.value("file") == name]
    body = block.code.partition("\n\n\n")[2]
    assert len([line for line in body.splitlines() if line]) <= 40
