"""The programs of the README's "Embed it in a robot", word for word, on every event loop."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rwt.blocking import Loop
from rwt_client.blocking import connect
from tests.docs.blocks import ROOT, Block, blocks_of
from tests.docs.processes import Running, commands_folder
from tests.processes import free_port
from tests.rwt.conftest import LOOPS

_PORT = "9090"
_ON_LOOP = """
import functools, anyio, rwt
anyio.run = functools.partial(anyio.run, backend={backend!r}, backend_options={options!r})
rwt.Server = functools.partial(rwt.Server, loop={loop!r})
"""


def _programs() -> Iterator[Block]:
    """What the README has for robots."""
    for block in blocks_of(ROOT / "README.md"):
        if "from rwt import Server" in block.code:
            yield block


PROGRAMS = tuple(_programs())


def test_hello_world_is_short_and_needs_one_import() -> None:
    lines = PROGRAMS[0].code.strip().splitlines()
    imports = [
        each for each in ast.parse(PROGRAMS[0].code).body if isinstance(each, ast.Import | ast.ImportFrom)
    ]
    assert (len(PROGRAMS), len(imports)) == (2, 1)
    assert len(lines) <= 8


@pytest.mark.parametrize("block", PROGRAMS, ids=("without_a_loop", "with_a_loop"))
def test_a_program_of_the_readme(block: Block, loop: Loop, tmp_path: Path) -> None:
    port = free_port()
    backend, options = LOOPS[loop]
    program = tmp_path / "program.py"
    program.write_text(
        _ON_LOOP.format(backend=backend, options=options, loop=loop) + block.code.replace(_PORT, str(port))
    )
    with Running([sys.executable, program.name], tmp_path, commands_folder(tmp_path / "commands")) as running:
        running.wait_for_port(port)
        with connect(f"ws://127.0.0.1:{port}") as client:
            assert client.call("/beep").success
            assert "/rosapi" in client.api.nodes()
        running.expect_no_complaint()
