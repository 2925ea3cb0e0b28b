"""`Server.run`: a program that does nothing but serve, by one process or by several."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from websockets.sync.client import connect

from rwt import Server, SettingsError
from rwt.server import Loop

_PROGRAM = """
import logging, sys
from rwt import Node, Server

def horn(graph):
    node = Node(graph, "horn")
    node.advertise_service("/beep", "std_srvs/Trigger", lambda request: {{"success": True}})
    return node

logging.basicConfig(level="INFO")
sys.exit(Server("ws://127.0.0.1:0", extra_nodes=[horn], {arguments}).run())
"""


@contextmanager
def running(arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The program, and where it listens."""
    process = subprocess.Popen(
        [sys.executable, "-c", _PROGRAM.format(arguments=arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("listening on ws://"), process.communicate()
        yield process, line.removeprefix("listening on ").strip()
    finally:
        process.kill()
        process.communicate()


def beeps(url: str) -> bool:
    """Return True if the program's service answers."""
    with connect(url) as wire:
        wire.send(json.dumps({"op": "call_service", "id": "1", "service": "/beep"}))
        return bool(json.loads(wire.recv(timeout=60))["result"])


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_a_signal_comes(loop: Loop, how: signal.Signals) -> None:
    with running(f"loop={loop!r}") as (process, url):
        assert beeps(url)
        process.send_signal(how)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "Traceback" not in errors


@pytest.mark.skipif(sys.platform != "linux", reason="workers share ports as Linux does")
def test_a_program_has_workers_too_with_its_own_nodes_once() -> None:
    with running("workers=2") as (process, url):
        for _ in range(4):
            assert beeps(url)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=100)
    assert process.returncode == 0, errors
    assert "worker 2 is up" in errors
    assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"distro": "noetic"}, "a graph of noetic cannot be joined over Zenoh; use 1"),
        ({"listen": ["stdio:"]}, "stdio: has one client"),
    ],
)
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no workers are refused first")
def test_what_several_processes_cannot_share(arguments: dict[str, Any], text: str) -> None:
    with pytest.raises(SettingsError) as refused:
        Server(workers=2, **arguments).run()
    assert text in str(refused.value)
