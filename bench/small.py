"""`python -m bench.small`: what the project needs of a small machine: time to start, memory, and disk.

It installs the project into an empty environment with pip, as a user does, and measures that: CPU time from
the start of `rwt serve` to the first client that it accepts, `rwt topic list` as a whole process, the memory
of a small robot, of a client and of the demo, and the size of what was installed. Prints tables in Markdown.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

from bench.traffic import messages
from bench.traffic.processes import Server
from bench.traffic.wire import Connection, Loop, masked

ROOT: Final = Path(__file__).parent.parent
EXTRAS: Final = ("fast", "mcap", "video", "zenoh")
UNUSED: Final = ("numpy", "pillow")
"""Dependencies that neither a client nor a server needs that has no pictures and no arrays."""
DEMO_SECONDS: Final = 5.0
CONNECT_SECONDS: Final = 30.0

ROBOT: Final = """
import anyio
from rwt import Server

async def main():
    async with Server("ws://127.0.0.1:0", nodes=()) as server:
        robot = server.node("robot")
        odometry = robot.advertise("/odom", "nav_msgs/Odometry")
        robot.subscribe("/cmd_vel", print, "geometry_msgs/Twist")
        print("listening on", server.urls[0], flush=True)
        while True:
            odometry.publish({"child_frame_id": "base"})
            await anyio.sleep(0.1)

anyio.run(main)
"""

CLIENT: Final = """
import sys, anyio
from rwt import connect

async def main():
    async with connect(sys.argv[1]) as robot:
        print(open("/proc/self/status").read(), flush=True)

anyio.run(main)
"""


@dataclass(frozen=True, slots=True)
class Used:
    """Resources used by one process.

    Attributes:
        seconds: of CPU time.
        memory: the most that was resident, in MB (10^6 bytes).
    """

    seconds: float
    memory: float


def whole_process(command: Sequence[str]) -> Used:
    """Run a program to its end.

    Raises:
        SystemExit: it failed.
    """
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment())
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    return Used(used.ru_utime + used.ru_stime, used.ru_maxrss * 1024 / 1e6)


def environment() -> dict[str, str]:
    """The environment of what is measured: nothing of the bench's own way to find modules."""
    hidden = ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "VIRTUAL_ENV")
    return {name: value for name, value in os.environ.items() if name not in hidden}


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def to_first_client(rwt: Sequence[str]) -> Used:
    """Start `rwt serve`, and stop when it has accepted a client, which tries from the beginning."""
    port = _free_port()
    command = [*rwt, "serve", f"ws://127.0.0.1:{port}"]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment()
    )
    try:
        with closing(Loop()) as loop:
            deadline = time.monotonic() + CONNECT_SECONDS
            while True:
                try:
                    client = Connection(loop, "127.0.0.1", port)
                    break
                except OSError:
                    if time.monotonic() > deadline or process.poll() is not None:
                        raise SystemExit("rwt serve accepts no client") from None
                    time.sleep(0.002)
            client.drop(reset=False)
    finally:
        process.kill()
        _, _, used = os.wait4(process.pid, 0)
        process.returncode = 0
    return Used(used.ru_utime + used.ru_stime, used.ru_maxrss * 1024 / 1e6)


@contextmanager
def running_program(python: str, arguments: Sequence[str]) -> Iterator[Server]:
    server = Server(arguments[0], arguments, quiet=True, python=python, environment=environment())
    try:
        yield server
    finally:
        server.stop()


def memory_of(python: str, arguments: Sequence[str], topic: str, seconds: float = 0.5) -> float:
    """Resident MB of a server with one client, which subscribes to a topic, after a while."""
    with running_program(python, arguments) as server, closing(Loop()) as loop:
        client = Connection(loop, server.host, server.port)
        client.send(masked(messages.Stream(topic, "nav_msgs/Odometry", ()).subscribe()))
        loop.until(lambda: False, seconds)
        client.drop(reset=False)
        return server.memory().now


def client_memory(python: str, url: str) -> float:
    """Resident MB of a Python program that is connected."""
    done = subprocess.run(
        [python, "-c", CLIENT, url], capture_output=True, text=True, check=True, env=environment()
    )
    (line,) = (each for each in done.stdout.splitlines() if each.startswith("VmRSS"))
    return int(line.split()[1]) * 1024 / 1e6


# -- installing ------------------------------------------------------------------------------------------


class Installed:
    """An environment with nothing but the project in it, and its dependencies."""

    def __init__(self, folder: Path, extra: str = "") -> None:
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        self.python = str(folder / "bin" / "python")
        (self._packages,) = folder.glob("lib/python*/site-packages")
        self._empty = self._sizes()
        self.pip("install", f"{ROOT}[{extra}]" if extra else str(ROOT))

    def pip(self, *arguments: str) -> None:
        """Run pip.

        Raises:
            CalledProcessError: it failed.
        """
        command = [self.python, "-m", "pip", *arguments, "--quiet", "--disable-pip-version-check"]
        subprocess.run(command, check=True, env=environment(), cwd="/")

    def _sizes(self) -> dict[str, int]:
        return {
            entry.name: sum(file.stat().st_size for file in (entry.rglob("*") if entry.is_dir() else [entry]))
            for entry in self._packages.iterdir()
        }

    def sizes(self) -> dict[str, float]:
        """MB of what was installed, by folder; wheels' metadata left out where it is small."""
        now = self._sizes()
        return {
            name: size / 1e6 for name, size in now.items() if self._empty.get(name) != size and size > 50_000
        }

    @property
    def size(self) -> float:
        """MB of all that was installed."""
        return (sum(self._sizes().values()) - sum(self._empty.values())) / 1e6


def processes_table(python: str, rounds: int) -> str:
    """Start and memory, as a table."""
    rwt = (python, "-m", "rwt.cli")
    serve = ("-m", "rwt.cli", "serve", "ws://127.0.0.1:0")
    to_first_client(rwt)  # once for the files to be read
    starts = [to_first_client(rwt) for _ in range(rounds)]
    with running_program(python, serve) as server:
        url = f"ws://{server.host}:{server.port}"
        listing = (*rwt, "topic", "list", "--url", url)
        whole_process(listing)
        lists = [whole_process(listing) for _ in range(rounds)]
        client = median(client_memory(python, url) for _ in range(rounds))
    helps = [whole_process((*rwt, "topic", "--help")) for _ in range(rounds)]
    robot = memory_of(python, ("-c", ROBOT), "/odom")
    demo = memory_of(python, (*serve, "--demo"), "/odom", DEMO_SECONDS)
    lines = [
        "| what | CPU | memory |",
        "|---|---:|---:|",
        f"| `rwt serve`, to the first client that it accepts | {_row(starts)} |",
        f"| `rwt topic list`, the whole process | {_row(lists)} |",
        f"| the help of `rwt topic` | {_row(helps)} |",
        f"| a Python client, connected | | {client:.0f} MB |",
        f"| a robot of one topic in a program of its own, one client | | {robot:.0f} MB |",
        f"| `rwt serve --demo`, one client | | {demo:.0f} MB |",
    ]
    return "\n".join(lines)


def _row(taken: Sequence[Used]) -> str:
    seconds = median(each.seconds for each in taken)
    return f"{seconds:.2f} s | {median(each.memory for each in taken):.0f} MB"


def disk_table(folder: Path, plain: Installed, extras: Sequence[str]) -> str:
    """Return a table of the disk space of an installation; uninstalls numpy and pillow at the end."""
    lines = ["| installed | MB |", "|---|---:|"]
    sizes = sorted(plain.sizes().items(), key=lambda item: -item[1])
    largest = ", ".join(f"{name} {size:.0f}" for name, size in sizes[:6])
    lines.append(f"| everything that clients and servers need ({largest}) | {plain.size:.0f} |")
    lines += [
        f"| with the extra `{extra}` | {Installed(folder / extra, extra).size:.0f} |" for extra in extras
    ]
    plain.pip("uninstall", "--yes", *UNUSED)
    whole_process((plain.python, "-c", ALONE))
    lines.append(f"| without {' and '.join(UNUSED)} | {plain.size:.0f} |")
    return "\n".join(lines)


ALONE: Final = """
import anyio
from rwt import Server, connect

async def main():
    async with Server("ws://127.0.0.1:0") as server:
        server.node("adder").advertise_service(
            "/add", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a + request.b}
        )
        async with connect(server.urls[0]) as robot:
            assert (await robot.call("/add", {"a": 1, "b": 2})).sum == 3

anyio.run(main)
"""
"""A server and a client that need no array and no picture."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.small", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="of each process (default 5)")
    parser.add_argument("--extras", action="store_true", help="install each extra too, which takes longer")
    options = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        plain = Installed(Path(folder) / "plain")
        print(processes_table(plain.python, options.rounds) + "\n", flush=True)
        print(disk_table(Path(folder), plain, EXTRAS if options.extras else ()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
