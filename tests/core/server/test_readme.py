"""The program for robots of the README, and the first of coroutines of "embed", on every event loop."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

from rwt.server import Loop
from rwt_client.blocking import connect
from tests.core.server.conftest import LOOPS
from tests.docs.blocks import ROOT, Block, blocks_of
from tests.docs.processes import Running, commands_folder
from tests.processes import free_port

_PORT = "9090"
_ON_LOOP = """
import functools, anyio, rwt
anyio.run = functools.partial(anyio.run, backend={backend!r}, backend_options={options!r})
rwt.Server = functools.partial(rwt.Server, loop={loop!r})
"""


def _program(page: str, has: str) -> Block:
    """The first block of a page in which something stands."""
    return next(block for block in blocks_of(ROOT / page) if has in block.code)


WITHOUT_A_LOOP = _program("README.md", "from rwt import Server")
WITH_A_LOOP = _program("docs/how-to/embed.md", ".run(main)")


def test_hello_world_is_short_and_needs_one_import() -> None:
    code = WITHOUT_A_LOOP.code.strip()
    imports = [each for each in ast.parse(code).body if isinstance(each, ast.Import | ast.ImportFrom)]
    assert len(imports) == 1
    assert len(code.splitlines()) <= 8


@pytest.mark.parametrize("block", [WITHOUT_A_LOOP, WITH_A_LOOP], ids=("without_a_loop", "with_a_loop"))
def test_a_program_of_the_pages(block: Block, loop: Loop, tmp_path: Path) -> None:
    port = free_port()
    backend, options = LOOPS[loop]
    program = tmp_path / "program.py"
    program.write_text(
        _ON_LOOP.format(backend=backend, options=options, loop=loop) + block.code.replace(_PORT, str(port))
    )
    with Running([sys.executable, program.name], tmp_path, commands_folder(tmp_path / "commands")) as running:
        running.wait_for_port(port)
        with connect(f"ws://127.0.0.1:{port}") as client:
            if block is WITHOUT_A_LOOP:
                assert client.call("/beep").success
            assert "/rosapi" in client.api.nodes()
        running.expect_no_complaint()
