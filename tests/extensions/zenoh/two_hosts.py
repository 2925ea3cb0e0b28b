"""Two hosts on one machine: network namespaces with a cable between them, and a server in each."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import pytest

#: Far more than anything takes; a test that waits so long has failed.
PATIENCE = 60.0

_NUMBERS = count()


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=PATIENCE)


def why_not() -> str:
    """Why there can be no namespaces here; empty if there can."""
    if shutil.which("ip") is None:
        return "there is no program `ip`"
    name = f"rwt-{os.getpid()}-try"
    try:
        _ip("netns", "add", name)
        _ip("netns", "del", name)
    except subprocess.CalledProcessError as error:
        return f"network namespaces are not permitted: {error.stderr.strip()}"
    return ""


@dataclass(frozen=True, slots=True)
class Cable:
    """Network between two hosts.

    Attributes:
        names: of the two namespaces.
        addresses: of the two hosts.
    """

    names: tuple[str, str]
    addresses: tuple[str, str] = ("10.77.0.1", "10.77.0.2")

    def cut(self, end: int) -> None:
        """Take one end down; the other has no carrier then."""
        _ip("-n", self.names[end], "link", "set", "cable", "down")

    def mend(self, end: int) -> None:
        """Put it up again."""
        _ip("-n", self.names[end], "link", "set", "cable", "up")


@contextmanager
def cable() -> Iterator[Cable]:
    """Two hosts, gone with all that is in them when the block is left; skips where that is not permitted."""
    if reason := why_not():
        pytest.skip(reason)
    number = next(_NUMBERS)
    made = Cable((f"rwt-{os.getpid()}-{number}a", f"rwt-{os.getpid()}-{number}b"))
    with ExitStack() as stack:
        for name in made.names:
            _ip("netns", "add", name)
            stack.callback(_ip, "netns", "del", name)
        a, b = made.names
        _ip("-n", a, "link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", b)
        for name, address in zip(made.names, made.addresses, strict=True):
            _ip("-n", name, "addr", "add", f"{address}/24", "dev", "cable")
            _ip("-n", name, "link", "set", "lo", "up")
            _ip("-n", name, "link", "set", "cable", "up")
        yield made


@dataclass(slots=True)
class Served:
    """A server that runs.

    Attributes:
        process: it.
        path: of the Unix socket where it serves, which is reached from every namespace.
        log: what it writes to standard error.
    """

    process: subprocess.Popen[str]
    path: Path
    log: Path

    def said(self, text: str) -> bool:
        """Return True if its log has a text."""
        return text in self.log.read_text()


@contextmanager
def serving(folder: Path, name: str, *arguments: str, within: str | None = None) -> Iterator[Served]:
    """`rwt serve --graph zenoh`, on a Unix socket, perhaps within a namespace; ready to be connected to."""
    path, log = folder / f"{name}.sock", folder / f"{name}.log"
    command = [sys.executable, "-m", "rwt.cli", "serve", f"unix://{path}", "--graph", "zenoh", *arguments]
    if within is not None:
        command = ["ip", "netns", "exec", within, *command]
    with log.open("a") as errors:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("listening on "), log.read_text()
        yield Served(process, path, log)
    finally:
        process.kill()
        process.communicate()


def until(condition: Callable[[], bool], what: str, patience: float = PATIENCE) -> float:
    """Wait until something is so; the seconds that it took.

    Raises:
        TimeoutError: it does not become so.
    """
    begin = time.monotonic()
    while not condition():
        if time.monotonic() - begin > patience:
            raise TimeoutError(f"{what}: not within {patience:g} s")
        time.sleep(0.005)
    return time.monotonic() - begin


@dataclass(slots=True)
class Client:
    """A rosbridge client, a JSON object a line.

    Attributes:
        heard: what came and was not asked for again.
    """

    wire: socket.socket
    heard: list[dict[str, Any]] = field(default_factory=list)
    _rest: bytes = b""

    def send(self, **op: object) -> None:
        """Send one op."""
        self.wire.sendall(json.dumps(op).encode() + b"\n")

    def read(self) -> list[dict[str, Any]]:
        """All that has come so far, since the beginning."""
        with suppress(BlockingIOError):
            while part := self.wire.recv(1 << 16, socket.MSG_DONTWAIT):
                self._rest += part
        *lines, self._rest = self._rest.split(b"\n")
        self.heard += [json.loads(line) for line in lines if line]
        return self.heard

    def on(self, topic: str) -> list[Any]:
        """The `data` of all messages of a topic so far."""
        return [op["msg"]["data"] for op in self.read() if op.get("topic") == topic]

    def answer(self, id: str) -> dict[str, Any] | None:
        """The answer to a call, if it has come."""
        return next((op for op in self.read() if op.get("id") == id), None)

    def call(self, service: str, id: str, **op: object) -> dict[str, Any]:
        """Call, and wait for the answer."""
        self.send(op="call_service", service=service, id=id, **op)
        until(lambda: self.answer(id) is not None, f"an answer of {service}")
        answer = self.answer(id)
        assert answer is not None
        return answer

    def serve(self) -> None:
        """Answer each call of `/go` that has come."""
        for op in [op for op in self.read() if op["op"] == "call_service" and op["service"] == "/go"]:
            self.heard.remove(op)
            values = {"success": True, "message": "gone"}
            self.send(op="service_response", service="/go", id=op["id"], values=values, result=True)


@contextmanager
def client(server: Served) -> Iterator[Client]:
    """A client of a server."""
    with socket.socket(socket.AF_UNIX) as wire:
        wire.connect(str(server.path))
        yield Client(wire)
