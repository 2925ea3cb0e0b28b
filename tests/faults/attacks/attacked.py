"""A server in a process of its own with bounded memory, an ordinary client of it, and what an attack does to
both."""

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

from tests.processes import ROOT, free_port, rwt_command

MIB: Final = 1 << 20

ADDRESS_SPACE: Final = 4096 * MIB
"""Beyond it the server's allocations fail."""


@dataclass(slots=True)
class Attacked:
    """A server, and an ordinary client of it."""

    process: subprocess.Popen[bytes]
    port: int
    distro: str
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
def attacked_server(distro: str, role: str) -> Iterator[Attacked]:
    """A server of which everybody has that role, with an ordinary client."""
    port = free_port()
    with tempfile.NamedTemporaryFile(suffix=".log") as log:
        process = _serve(port, distro, role, log)
        try:
            resource.prlimit(process.pid, resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
            with _piped("ordinary_client", str(port)) as ordinary:
                attacked = Attacked(process, port, distro, Path(log.name), ordinary)
                attacked.worst_wait()  # answered once it is connected
                time.sleep(0.5)
                attacked.undisturbed = attacked.worst_wait()
                yield attacked
        finally:
            process.kill()
            process.communicate()


def _serve(port: int, distro: str, role: str, log: IO[bytes]) -> subprocess.Popen[bytes]:
    own = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
    process = subprocess.Popen(
        rwt_command(
            "serve",
            f"ws://127.0.0.1:{port}",
            "--distro",
            distro,
            "--set",
            f"auth.default_role={role}",
            "--set",
            'proxies=["127.0.0.1"]',
        ),
        stdout=subprocess.PIPE,
        stderr=log,
        env={**own, "PYTHONPATH": str(ROOT / "src")},
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith(b"listening on ")
    return process


@dataclass(frozen=True, slots=True)
class Damage:
    """What an attack has done.

    Attributes:
        waited: seconds that the ordinary client waited at most.
        undisturbed: the same while nobody attacked.
        grown: MiB by which the server grew at most.
        logged: bytes that it wrote to its log.
        files: that were open before.
        memory: MiB that it used before.
    """

    waited: float
    undisturbed: float
    grown: float
    logged: int
    files: int
    memory: float

    def __str__(self) -> str:
        waited = f"waited {self.waited * 1000:.0f} ms ({self.undisturbed * 1000:.0f} undisturbed)"
        return f"{waited}, grown by {self.grown:.0f} MiB, logged {self.logged} bytes"


def suffer(attack: str, server: Attacked) -> Damage:
    """Attack a server, and wait until the attacker has gone."""
    if attack == "expensive_videos":
        _run("small_video", server)  # loads the libraries, which are not what is measured
    server.worst_wait()
    before, files, logged = server.memory(), server.files(), server.log.stat().st_size
    server.forget_peak()
    with _piped("attacker", str(server.port), attack, server.distro) as attacker:
        _await_end(attacker)
        waited = server.worst_wait()
        grown = server.memory("VmHWM") - before
    written = server.log.stat().st_size - logged
    return Damage(waited, server.undisturbed, grown, written, files, before)


def _run(attack: str, server: Attacked) -> None:
    with _piped("attacker", str(server.port), attack, server.distro) as attacker:
        _await_end(attacker)


def _await_end(attacker: subprocess.Popen[str]) -> None:
    assert attacker.stdout is not None
    assert attacker.stdout.readline() == "done\n"
