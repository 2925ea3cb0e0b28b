"""A process that may have no more open files."""

from __future__ import annotations

import os
import resource
import socket
import subprocess
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest

from tests.faults.blocking_client import PATIENCE, BlockingClient
from tests.processes import ROOT
from tests.waiting import wait_until

LEFT = 64
"""Descriptors that the server may have."""
_PROGRAM = """
import logging, sys
from rwt import Server
logging.basicConfig(level=logging.INFO)
Server("ws://127.0.0.1:0", loop=sys.argv[1]).run(announce=lambda text: print(text, flush=True))
"""


@pytest.mark.parametrize("loop", ["asyncio", "trio", "uvloop"])
def test_a_server_out_of_descriptors_says_so_once_and_takes_clients_when_there_are_some(
    loop: str, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    with log.open("wb") as errors, ExitStack() as stack:
        server = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-c", _PROGRAM, loop],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                preexec_fn=partial(resource.setrlimit, resource.RLIMIT_NOFILE, (LEFT // 2, LEFT)),
                env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
            )
        )
        stack.callback(server.terminate)
        assert server.stdout is not None
        port = int(server.stdout.readline().rpartition(":")[2])
        with ExitStack() as crowd:
            for _ in range(2 * LEFT):
                crowd.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE))
            wait_until(lambda: "no connection can be accepted" in log.read_text())
            size = log.stat().st_size
            # The kernel keeps who came last; the server tries again, and says nothing more.
            wait_until(lambda: _descriptors(server.pid) == LEFT)
            assert log.stat().st_size == size
        with BlockingClient(port) as client:
            client.say("call_service", id="x", service="/rosapi/get_time")
            assert client.hear("service_response", id="x")["result"]
        assert server.poll() is None
    assert log.read_text().count("no connection can be accepted") == 1
    assert "Traceback" not in log.read_text()


def _descriptors(pid: int) -> int:
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))
