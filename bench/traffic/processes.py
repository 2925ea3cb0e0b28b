"""One server as a child process: started, watched through /proc, stopped."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.traffic.dialects import ROSBRIDGE, Dialect

STARTUP_SECONDS = 20.0
STOP_SECONDS = 5.0
LISTENING = re.compile(r"listening on ws://([^:/\s]+):(\d+)")
TICK = os.sysconf("SC_CLK_TCK")


class ServerFailed(Exception):
    """The server did not start, or it died."""


@dataclass(frozen=True, slots=True)
class Memory:
    """Resident memory in MB (10^6 bytes): now, and the most there ever was."""

    now: float
    peak: float


@dataclass(frozen=True, slots=True)
class CpuTime:
    """CPU time of a process so far, in seconds, over all its threads.

    Attributes:
        used: spent on a CPU.
        waited: ready to run, with the CPU given to somebody else; 0 where the kernel does not count it.
    """

    used: float
    waited: float


def cpu_time(pid: int) -> CpuTime:
    try:
        texts = [(task / "schedstat").read_text() for task in Path(f"/proc/{pid}/task").iterdir()]
        used, waited, _ = zip(*(map(int, text.split()) for text in texts), strict=True)
        return CpuTime(sum(used) / 1e9, sum(waited) / 1e9)
    except FileNotFoundError:  # a kernel without schedstat: clock ticks, usually of 10 ms
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return CpuTime((int(fields[11]) + int(fields[12])) / TICK, 0.0)


class Server:
    """A server that prints `listening on ws://HOST:PORT` on its standard output when it is ready."""

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        cpus: Iterable[int] | None = None,
        dialect: Dialect = ROSBRIDGE,
        *,
        quiet: bool = False,
        python: str = sys.executable,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.name = name
        self.dialect = dialect
        self._process = subprocess.Popen(
            [python, *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL if quiet else None,
            text=True,
            errors="replace",
        )
        self._proc = Path(f"/proc/{self._process.pid}")
        if cpus is not None:
            os.sched_setaffinity(self._process.pid, cpus)
        try:
            self.host, self.port = self._address()
        except ServerFailed:
            self.stop()
            raise

    @property
    def pid(self) -> int:
        return self._process.pid

    def _address(self) -> tuple[str, int]:
        assert self._process.stdout is not None
        watchdog = threading.Timer(STARTUP_SECONDS, self._process.kill)
        watchdog.start()
        try:
            for line in self._process.stdout:
                if found := LISTENING.search(line):
                    threading.Thread(target=self._drain, daemon=True).start()
                    return found[1], int(found[2])
        finally:
            watchdog.cancel()
        raise ServerFailed(f"{self.name} ended, or said nothing for {STARTUP_SECONDS:g} s, before listening")

    def _drain(self) -> None:
        """Read on, so that a talkative server never waits for a full pipe."""
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for _ in lines:
                pass

    @property
    def fate(self) -> str:
        """State of the process, as text."""
        code = self._process.poll()
        return "it still runs" if code is None else f"it ended with exit code {code}"

    def cpu_time(self) -> CpuTime:
        return cpu_time(self._process.pid)

    def memory(self) -> Memory:
        text = (self._proc / "status").read_text()
        sizes = {key: int(kib) * 1024 / 1e6 for key, kib in re.findall(r"^(Vm\w+):\s+(\d+) kB", text, re.M)}
        return Memory(sizes["VmRSS"], sizes["VmHWM"])

    def files(self) -> int:
        """Number of open files and sockets."""
        return sum(1 for _ in (self._proc / "fd").iterdir())

    def stop(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
