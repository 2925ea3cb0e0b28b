"""The disk of the log is full: the robot is served all the same."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT
from tests.faults.blocking_client import BlockingClient
from tests.faults.conftest import Robot

FULL = Path("/dev/full")
NAMES = ("rwt.bridge", "rwt_transports", "rwt_graph")


@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_server_whose_log_cannot_be_written() -> None:
    with FULL.open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "rwt.cli", "serve", "ws://127.0.0.1:0"],
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        )
    with process:
        try:
            assert process.stdout is not None
            found = re.search(r"listening on ws://127\.0\.0\.1:(\d+)", process.stdout.readline())
            assert found is not None
            with BlockingClient(int(found[1])) as client:
                client.say("no such op")
                client.ask_something()
        finally:
            process.terminate()
            assert process.wait(10) == 0


class _FullDisk(logging.Handler):
    """A handler that does what a handler must not: it lets its trouble out."""

    def emit(self, record: logging.LogRecord) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextmanager
def full_disk() -> Iterator[None]:
    """Every record of the server raises."""
    handler = _FullDisk()
    loggers = [logging.getLogger(name) for name in NAMES]
    before = [each.level for each in loggers]
    for each in loggers:
        each.addHandler(handler)
        each.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        for each, level in zip(loggers, before, strict=True):
            each.removeHandler(handler)
            each.setLevel(level)


def test_a_log_handler_that_raises_costs_at_most_the_connections_it_speaks_of(robot: Robot) -> None:
    with robot.connect() as other, robot.connect() as bad, robot.connect() as silent:
        other.say("subscribe", topic="/t", type="std_msgs/String")
        with full_disk():
            bad.say("no such op")
            with contextlib.suppress(ConnectionError):
                robot.connect().socket.close()
            silent.reset()
            for _ in range(10):
                # Longer than a silent client may be, so that time-outs are looked after meanwhile.
                time.sleep(0.12)
                other.say("publish", topic="/t", msg={"data": "still here"})
                assert other.hear("publish")["msg"] == {"data": "still here"}
        with robot.connect() as late:
            late.ask_something()
        other.ask_something()
