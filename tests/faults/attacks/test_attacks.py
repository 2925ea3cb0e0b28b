"""Attacks on a server in a process of its own, with default settings and bounded memory.

What must hold of each, whatever its client does: an ordinary client is answered soon, the server's memory,
open files and log are bounded, and all is given back when the attacker has left.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

import pytest

from tests.faults.attacks.attacker import ATTACKS
from tests.processes import ROOT, free_port, rwt_command

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="memory and open files are read from /proc")

MIB: Final = 1 << 20

ADDRESS_SPACE: Final = 4096 * MIB
"""Beyond it the server's allocations fail."""

VIEWER, ADMIN = 150, 400
"""MiB by which a client may make the server grow: one that only looks, and one with every right."""

GIVEN_BACK: Final = 150
"""MiB of which the allocator may still hold some for later when the attacker has left."""

LOG_BYTES: Final = 300_000
"""Of one attack."""

SOON: Final = 0.5
"""Seconds in which an ordinary client is answered while a server is attacked, or else twenty times what it
waits at most while nobody attacks: other work on the machine makes everything wait."""

OF_VIEWERS: Final = frozenset(
    {"rosapi_flood", "many_in_a_frame", "fragments_left_open", "colliding_keys", "empty_maps",
     "nested_arrays", "deep_json", "many_in_a_member", "constants", "long_numbers",
     "expensive_videos", "refusals"}
)  # fmt: skip
"""Attacks for which no right is needed beyond looking."""

KEEPING: Final = frozenset(
    {"throttled_queue", "endless_depth", "latched_topics", "lingering_publishers", "endless_goals",
     "unanswered_calls", "parameters", "spellings"}
)  # fmt: skip
"""Attacks that leave something behind for a while, as they may: each has a server of its own."""

OF_NOETIC: Final = frozenset({"parameters"})
"""Attacks on ROS 1; the others are on ROS 2."""


@dataclass(slots=True)
class Attacked:
    """A server, and an ordinary client of it."""

    process: subprocess.Popen[bytes]
    port: int
    log: Path
    ordinary: subprocess.Popen[str]
    undisturbed: float = 0.0

    def worst_wait(self) -> float:
        """Seconds that the ordinary client waited for an answer at most, since it was asked the last time."""
        assert self.ordinary.stdin is not None and self.ordinary.stdout is not None
        self.ordinary.stdin.write("\n")
        self.ordinary.stdin.flush()
        return float(self.ordinary.stdout.readline())

    def memory(self, which: str = "VmRSS") -> float:
        """MiB."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        (line,) = (line for line in status.splitlines() if line.startswith(which))
        return int(line.split()[1]) / 1024

    def forget_peak(self) -> None:
        """Let the peak of memory begin at what is used now."""
        Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")

    def files(self) -> int:
        """Open files and connections."""
        return len(os.listdir(f"/proc/{self.process.pid}/fd"))


@contextmanager
def _piped(module: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A program of this package, until the end of its input."""
    command = [sys.executable, "-m", f"tests.faults.attacks.{module}", *arguments]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"}
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def _attacked(distro: str) -> Iterator[Attacked]:
    port = free_port()
    with tempfile.NamedTemporaryFile(suffix=".log") as log:
        process = _serve(port, distro, log)
        try:
            resource.prlimit(process.pid, resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
            with _piped("ordinary_client", str(port)) as ordinary:
                attacked = Attacked(process, port, Path(log.name), ordinary)
                attacked.worst_wait()  # answered once it is connected
                time.sleep(0.5)
                attacked.undisturbed = attacked.worst_wait()
                yield attacked
        finally:
            process.kill()
            process.communicate()


def _serve(port: int, distro: str, log: IO[bytes]) -> subprocess.Popen[bytes]:
    own = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
    process = subprocess.Popen(
        rwt_command("serve", f"ws://127.0.0.1:{port}", "--distro", distro),
        stdout=subprocess.PIPE,
        stderr=log,
        env={**own, "PYTHONPATH": str(ROOT / "src")},
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith(b"listening on ")
    return process


@pytest.fixture(scope="module")
def server() -> Iterator[Attacked]:
    """One for the attacks after which nothing is kept."""
    with _attacked("jazzy") as attacked:
        yield attacked


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_server_under_attack(attack: str, request: pytest.FixtureRequest) -> None:
    if attack in KEEPING:
        with _attacked("noetic" if attack in OF_NOETIC else "jazzy") as server:
            _check(attack, server)
    else:
        _check(attack, request.getfixturevalue("server"))


def _check(attack: str, server: Attacked) -> None:
    if attack == "expensive_videos":
        _run("small_video", server)  # loads the libraries, which are not what is measured
    server.worst_wait()
    before, files, logged = server.memory(), server.files(), server.log.stat().st_size
    server.forget_peak()
    with _piped("attacker", str(server.port), attack) as attacker:
        _await_end(attacker)
        wait = server.worst_wait()
        grown = server.memory("VmHWM") - before
    allowed = VIEWER if attack in OF_VIEWERS else ADMIN
    soon = max(20 * server.undisturbed, SOON)
    written = server.log.stat().st_size - logged
    _given_back(server, files, before + GIVEN_BACK)
    found = f"waited {wait * 1000:.0f} ms, grown by {grown:.0f} MiB, logged {written} bytes"
    assert wait < soon, found
    assert grown < allowed, found
    assert written < LOG_BYTES, found


def _run(attack: str, server: Attacked) -> None:
    with _piped("attacker", str(server.port), attack) as attacker:
        _await_end(attacker)


def _await_end(attacker: subprocess.Popen[str]) -> None:
    assert attacker.stdout is not None
    assert attacker.stdout.readline() == "done\n"


def _given_back(server: Attacked, files: int, memory: float) -> None:
    """Wait until the attacker's connections are closed, and its memory is free."""
    deadline = time.monotonic() + 10.0
    while (still := server.files()) > files or server.memory() > memory:
        assert time.monotonic() < deadline, f"{still} open files, {server.memory():.0f} MiB"
        time.sleep(0.02)
    server.worst_wait()
