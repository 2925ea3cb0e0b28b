"""Servers in processes of their own, perhaps on a second host, and clients of them."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.waiting import wait_until


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
def serving(folder: Path, name: str, *arguments: str, prefix: Sequence[str] = ()) -> Iterator[Served]:
    """`rwt serve --graph zenoh`, on a Unix socket, ready to be connected to; `prefix` stands before it."""
    path, log = folder / f"{name}.sock", folder / f"{name}.log"
    command = [sys.executable, "-m", "rwt.cli", "serve", f"unix://{path}", "--graph", "zenoh", *arguments]
    with log.open("a") as errors:
        process = subprocess.Popen([*prefix, *command], stdout=subprocess.PIPE, stderr=errors, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("listening on "), log.read_text()
        yield Served(process, path, log)
    finally:
        process.kill()
        process.communicate()


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
        wait_until(lambda: self.answer(id) is not None)
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
