"""Every example of the documentation does what its page says."""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from websockets.sync.client import ClientConnection, connect

from tests.docs.blocks import ALL_BLOCKS, ROOT, Block
from tests.docs.processes import LIMIT, Running, commands_folder
from tests.processes import free_port

_CLIENTS = ROOT / "tests" / "clients" / "node"
_PORT = "9090"

_INSIDE = """\
import logging

import anyio

from rwt_graph import MemoryGraph, Node

logging.basicConfig(level=logging.WARNING)


async def main() -> None:
    async with MemoryGraph() as graph:
        robot = Node(graph, "my_robot")
{code}

anyio.run(main)
"""


class Examples:
    """Runs blocks; a page's files share a folder, and pages do not see each other's."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._commands = commands_folder(folder / "commands")
        self._servers = ExitStack()
        self._ports: dict[str, int] = {}

    def close(self) -> None:
        self._servers.close()

    def demo_port(self, distro: str) -> int:
        """The port of the demo robot of a distribution, started when it is first asked for."""
        if distro not in self._ports:
            folder = self._folder / f"demo_{distro}"
            folder.mkdir()
            port = self._ports[distro] = free_port()
            url = f"ws://127.0.0.1:{port}"
            command = [sys.executable, "-m", "rwt.cli", "serve", "--demo", "--distro", distro, url]
            self._servers.enter_context(Running(command, folder, self._commands)).wait_for_port(port)
        return self._ports[distro]

    def folder_of(self, block: Block, port: int) -> Path:
        """A fresh folder with the files of the block's page in it, and the npm clients within reach."""
        folder = self._folder / block.name.replace("/", "_").replace(":", "_")
        folder.mkdir()
        if block.language in ("js", "html"):
            _offer_npm_packages(folder)
        for other in ALL_BLOCKS:
            if other.page == block.page and (name := other.value("file")):
                file = folder / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(other.code.replace(_PORT, str(port)), encoding="utf-8")
        return folder

    def start(self, block: Block, folder: Path, port: int) -> Running:
        """The block as a program, running."""
        code = block.code.replace(_PORT, str(port))
        if block.value("run") == "inside":
            code = _INSIDE.format(code=textwrap.indent(code, " " * 8))
        return Running(_command(block, folder, code), folder, self._commands)

    def run_file(self, name: str, folder: Path) -> Running:
        """A program that the page wrote to a file."""
        return Running([sys.executable, name], folder, self._commands)


def _offer_npm_packages(folder: Path) -> None:
    packages = _CLIENTS / "node_modules"
    if not packages.is_dir():
        pytest.fail(
            "the npm clients are not installed: run `npm ci --prefix tests/clients/node`", pytrace=False
        )
    (folder / "node_modules").symlink_to(packages)


def _command(block: Block, folder: Path, code: str) -> list[str]:
    suffix = {"python": "py", "js": "mjs", "sh": "sh", "toml": "toml", "html": "html"}[block.language]
    file = folder / (block.value("file") or f"example.{suffix}")
    file.write_text(code, encoding="utf-8")
    if block.value("run") == "pytest":
        plugins = (
            "no:cacheprovider",
            "rwt.testing.pytest_plugin",
            "rwt_rclpy.pytest_plugin",
            "anyio",
        )
        return [sys.executable, "-m", "pytest", "-q", *(f"-p{name}" for name in plugins), file.name]
    if block.value("run") == "vitest":
        return ["node", str(_CLIENTS / "node_modules" / "vitest" / "vitest.mjs"), "run", file.name]
    if block.language == "toml":
        return [sys.executable, "-m", "rwt.cli", "serve", "--config", file.name]
    if block.language == "html":
        return ["node", str(Path(__file__).with_name("page_in_node.mjs")), str(file), str(_CLIENTS)]
    interpreter = {"python": [sys.executable], "js": ["node"], "sh": ["sh", "-eu"]}[block.language]
    return [*interpreter, file.name]


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Examples]:
    running = Examples(tmp_path_factory.mktemp("examples"))
    yield running
    running.close()


def _blocks(*runs: str) -> pytest.MarkDecorator:
    chosen = [block for block in ALL_BLOCKS if block.value("run") in runs]
    return pytest.mark.parametrize("block", chosen, ids=[block.name for block in chosen])


def test_every_block_says_what_to_do_with_it() -> None:
    unmarked = [
        block.name
        for block in ALL_BLOCKS
        if not any(block.value(key) for key in ("run", "file", "step", "not run"))
    ]
    assert unmarked == []


def test_only_known_ways_to_run() -> None:
    known = {"program", "inside", "client", "server", "wire", "page", "browser", "pytest", "vitest", ""}
    assert {block.value("run") for block in ALL_BLOCKS} <= known


@_blocks("program", "inside", "pytest", "vitest")
def test_program(block: Block, examples: Examples) -> None:
    port = free_port()
    with examples.start(block, examples.folder_of(block, port), port) as program:
        for text in block.values("prints"):
            program.wait_for(text)
        program.expect_end()


@_blocks("client", "page")
def test_client(block: Block, examples: Examples) -> None:
    server = block.value("against")
    port = free_port() if server else examples.demo_port("noetic" if block.value("noetic") else "jazzy")
    folder = examples.folder_of(block, port)
    with ExitStack() as running:
        if server:
            running.enter_context(examples.run_file(server, folder)).wait_for_port(port)
        client = running.enter_context(examples.start(block, folder, port))
        for text in block.values("prints"):
            client.wait_for(text)
        if not block.values("prints"):
            client.expect_end()


@_blocks("server")
def test_server(block: Block, examples: Examples) -> None:
    port = free_port()
    with examples.start(block, examples.folder_of(block, port), port) as server:
        server.wait_for_port(port)
        with connect(f"ws://127.0.0.1:{port}") as wire:
            for call in block.values("call"):
                _call(wire, call)
            for heard in block.values("hear"):
                _hear(wire, heard)
        for text in block.values("prints"):
            server.wait_for(text)
        server.expect_no_complaint()


@_blocks("wire")
def test_wire(block: Block, examples: Examples) -> None:
    port = examples.demo_port("noetic" if block.value("noetic") else "jazzy")
    with connect(f"ws://127.0.0.1:{port}") as wire:
        for line in block.code.splitlines():
            direction, _, text = line.partition(" ")
            if direction == ">":
                wire.send(text)
            elif direction == "<":
                _receive(wire, json.loads(text))
            else:
                assert not line.strip(), f"a line is `> sent` or `< received`, not {line!r}"


def _receive(
    wire: ClientConnection, wanted: object, on_other: Callable[[object], None] | None = None
) -> None:
    """Read on until a message with at least what is wanted."""
    other: list[object] = []
    while True:
        try:
            got = json.loads(wire.recv(timeout=LIMIT))
        except TimeoutError:
            raise AssertionError(f"{wanted} did not come, but {other[-20:]}") from None
        if _contains(got, wanted):
            return
        other.append(got)
        if on_other is not None:
            on_other(got)


def _ask(wire: ClientConnection, asked: dict[str, object], wanted: object) -> None:
    """Ask until a message comes with at least what is wanted.

    A program listens before it offers what it offers; until then it is asked again.
    """
    wire.send(json.dumps(asked))

    def again(got: object) -> None:
        if any(text in str(got) for text in ("does not exist", "cannot infer the type")):
            wire.send(json.dumps(asked))

    _receive(wire, wanted, again)


def _contains(got: object, wanted: object) -> bool:
    if isinstance(got, dict) and isinstance(wanted, dict):
        return all(key in got and _contains(got[key], value) for key, value in wanted.items())
    return got == wanted


def _call(wire: ClientConnection, call: str) -> None:
    request, _, values = call.partition(" -> ")
    service, _, args = request.partition(" ")
    message = {"op": "call_service", "id": call, "service": service, "args": json.loads(args or "{}")}
    answer = {"op": "service_response", "id": call, "result": True, "values": json.loads(values or "{}")}
    _ask(wire, message, answer)


def _hear(wire: ClientConnection, heard: str) -> None:
    topic, _, message = heard.partition(" ")
    wanted = {"op": "publish", "topic": topic, "msg": json.loads(message or "{}")}
    _ask(wire, {"op": "subscribe", "topic": topic}, wanted)
