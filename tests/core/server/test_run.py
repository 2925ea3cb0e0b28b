"""`Server.run`: a program that does nothing but serve, by several processes."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from typing import Any

import pytest
from websockets.sync.client import connect

from rwt import Server, SettingsError

_PROGRAM = """
import logging, sys
from rwt import Node, Server

def horn(graph):
    node = Node(graph, "horn")
    node.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"success": True})
    return node

logging.basicConfig(level="INFO")
sys.exit(Server("ws://127.0.0.1:0", extra_nodes=[horn], workers=2).run())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="workers share ports as Linux does")
def test_a_program_has_workers_too_with_its_own_nodes_once() -> None:
    command, pipe = [sys.executable, "-c", _PROGRAM], subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        url = process.stdout.readline().removeprefix("listening on ").strip()
        for _ in range(4):
            with connect(url) as wire:
                wire.send(json.dumps({"op": "call_service", "id": "1", "service": "/beep"}))
                assert json.loads(wire.recv(timeout=60))["result"] is True
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
