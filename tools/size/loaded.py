"""Lines of source that a default server loads: at startup, and after one client of each protocol.

The server is ``Server().run()``, without the command line of `rwt serve`. Run as a program, this module is
that server: it answers each line of its standard input with the files of the loaded modules, as a line of
JSON, and stops at the end of its input.
"""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:  # The server's process imports nothing that it would not import by itself.
    from websockets.sync.client import ClientConnection

    from tools.size.layout import Layout

_SECONDS: Final = 20.0
"""Longest wait for an answer."""

_TWIST: Final = {"linear": {"x": 0.25, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": -0.5}}


_IMPORTS: Final = 15
"""Number of processes of which the median is taken."""


@dataclass(frozen=True, slots=True)
class Loaded:
    """Modules of the project in a process.

    Attributes:
        modules: number of modules.
        lines: lines of their source.
    """

    modules: int
    lines: int


def measure(layout: Layout) -> tuple[Loaded, Loaded]:
    """Return what a server has loaded at startup, and after the clients."""
    with _running(layout) as (process, url):
        startup = _ask(process, layout)
        _connect_clients(url)
        return startup, _ask(process, layout)


def import_seconds(layout: Layout) -> tuple[float, float]:
    """Return time and CPU time of a process that only imports the server, with compiled bytecode."""
    environment = layout.environment()
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    seconds = []
    cpu_seconds = []
    for _ in range(_IMPORTS + 1):
        start, before = time.perf_counter(), os.times()
        command = [sys.executable, "-c", "from rwt import Server"]
        subprocess.run(command, cwd=layout.root, env=environment, check=True)
        seconds.append(time.perf_counter() - start)
        after = os.times()
        used = after.children_user + after.children_system
        cpu_seconds.append(used - before.children_user - before.children_system)
    # The first process may compile.
    return round(statistics.median(seconds[1:]), 2), round(statistics.median(cpu_seconds[1:]), 2)


@contextmanager
def _running(layout: Layout) -> Iterator[tuple[subprocess.Popen[str], str]]:
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        cwd=layout.root,
        env=layout.environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process, _line_with(process, "ws://").split()[-1]
    finally:
        process.communicate(timeout=_SECONDS)


def _line_with(process: subprocess.Popen[str], text: str) -> str:
    assert process.stdout is not None
    for line in process.stdout:
        if text in line:
            return line.strip()
    raise RuntimeError(f"the server ended without a line with {text!r}")


def _ask(process: subprocess.Popen[str], layout: Layout) -> Loaded:
    from tools.size.layout import within

    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()
    files = json.loads(_line_with(process, "["))
    ours = [Path(each) for each in files if within(each, layout.packages.values())]
    return Loaded(len(ours), sum(each.read_text(encoding="utf-8").count("\n") for each in ours))


def _connect_clients(url: str) -> None:
    """Connect a client of rosbridge, one of Foxglove and one of HTTP."""
    from urllib.request import urlopen

    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    with (
        connect(url) as rosbridge,
        connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as foxglove,
    ):

        def say(**op: object) -> None:
            rosbridge.send(json.dumps(op))

        def heard(op: str) -> Any:
            while (found := json.loads(rosbridge.recv(_SECONDS)))["op"] != op:
                pass
            return found

        say(op="advertise", topic="/cmd_vel", type="geometry_msgs/Twist")
        say(op="subscribe", topic="/cmd_vel", type="geometry_msgs/Twist")
        say(op="publish", topic="/cmd_vel", msg=_TWIST)
        heard("publish")
        say(op="call_service", service="/rosapi/topics", id="1")
        heard("service_response")
        _subscribe_foxglove(foxglove)
        say(op="publish", topic="/cmd_vel", msg=_TWIST)
        while isinstance(foxglove.recv(_SECONDS), str):
            pass
    root = url.replace("ws", "http", 1).rstrip("/")
    for path in ("/api", "/api/topics"):
        with urlopen(root + path, timeout=_SECONDS) as response:
            response.read()


def _subscribe_foxglove(client: ClientConnection) -> None:
    """Subscribe to /cmd_vel, and wait until the subscription holds."""
    channel = None
    while channel is None:
        told = client.recv(_SECONDS)
        if isinstance(told, str) and (op := json.loads(told))["op"] == "advertise":
            channel = next((each["id"] for each in op["channels"] if each["topic"] == "/cmd_vel"), None)
    client.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channel}]}))
    # A pong comes after what was sent before the ping.
    client.ping().wait(_SECONDS)


def _answer() -> None:
    for _ in sys.stdin:
        files = {getattr(each, "__file__", None) for each in list(sys.modules.values())}
        print(json.dumps(sorted(filter(None, files))), flush=True)
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    threading.Thread(target=_answer, daemon=True).start()
    from rwt import Server

    sys.exit(Server("ws://127.0.0.1:0").run())
