"""A server in a process of its own, and WebSocket clients of it, for tests that speak over the wire only.

The tests of this folder import nothing of the server, so they also run on an older version: copy the folder
into a checkout of it.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from websockets.sync.client import ClientConnection, connect

from tests.processes import running

LONGEST_S: Final = 20.0
"""Seconds; far more than any answer takes."""


@dataclass(frozen=True, slots=True)
class Served:
    """A running server.

    Attributes:
        process: its process.
        host: address of its first listener, such as `127.0.0.1:9090`.
        log: file with its log.
    """

    process: subprocess.Popen[str]
    host: str
    log: Path

    def connect(self, path: str = "/", headers: Mapping[str, str] | None = None, **options: Any) -> Client:
        """Return a connected rosbridge client."""
        options = {"compression": None, "max_size": None, "open_timeout": LONGEST_S, **options}
        with ExitStack() as stack:
            manager = connect(f"ws://{self.host}{path}", additional_headers=headers, **options)
            return Client(stack.enter_context(manager), stack.pop_all())


class Client:
    """A rosbridge client; close it, or use it as a context manager."""

    def __init__(self, connection: ClientConnection, stack: ExitStack) -> None:
        self.connection = connection
        self._stack = stack

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._stack.close()

    def send(self, op: str, **members: Any) -> None:
        self.connection.send(json.dumps({"op": op, **members}))

    def receive(self) -> dict[str, Any]:
        """Return the next message.

        Raises:
            TimeoutError: none arrives.
        """
        message: dict[str, Any] = json.loads(self.connection.recv(LONGEST_S))
        return message

    def wait_for(self, **members: Any) -> dict[str, Any]:
        """Return the next message with these members."""
        while True:
            message = self.receive()
            if all(message.get(name) == value for name, value in members.items()):
                return message

    def call(self, service: str, id: str = "call", **arguments: Any) -> dict[str, Any]:
        """Return the response of a service."""
        self.send("call_service", service=service, id=id, args=arguments)
        return self.wait_for(op="service_response", id=id)


@contextmanager
def served(folder: Path, settings: str, *arguments: str, url: str = "ws://127.0.0.1:0") -> Iterator[Served]:
    """Start `rwt serve` with settings in TOML; its log is a file in `folder`."""
    file, log = folder / "settings.toml", folder / "log"
    file.write_text(settings)
    with log.open("w") as lines:
        command = ("serve", url, "--config", str(file), *arguments)
        with running(*command, stderr=lines.fileno()) as (process, listening):
            yield Served(process, listening.rpartition("//")[2].strip("/"), log)
