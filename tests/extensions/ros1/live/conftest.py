"""Tests against real ROS 1 programs: `make test-ros1`.

They are skipped where Debian's packages of ROS 1 are not installed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from pathlib import Path
from typing import Final

import anyio.to_thread
import pytest

from rwt.extensions.ros1 import Ros1Graph
from tests.extensions.ros1.live.relay import UNSEEN_TYPES, Relay, build_relay
from tests.processes import free_port, running
from tests.statements import Program
from tests.waiting import until_answered

HAS_ROS = shutil.which("rosmaster", path="/usr/bin") is not None

#: Seconds that the master has to answer, and that a tool has to end.
_PATIENCE: Final = 60


@pytest.fixture(autouse=True)
def needs_ros() -> None:
    """Skip every test without ROS 1."""
    if not HAS_ROS:
        pytest.skip("needs ROS 1: run `make test-ros1`, which installs Debian's packages of it")


class Ros:
    """A ROS 1 master, and programs that use it.

    Args:
        host: address of the master and of the programs, by default on this host.

    Attributes:
        uri: address of the master.
    """

    def __init__(self, folder: Path, host: str = "127.0.0.1") -> None:
        self.port = free_port()
        self.uri = f"ros1://{host}:{self.port}"
        self.environment = {
            "PATH": "/usr/bin:/bin",
            "HOME": str(folder),
            "ROS_HOME": str(folder),
            "ROS_MASTER_URI": f"http://{host}:{self.port}",
            "ROS_IP": host,
            "ROS_PACKAGE_PATH": "/usr/share",
            "PYTHONUNBUFFERED": "1",
        }
        self._programs = ExitStack()
        self._master: subprocess.Popen[bytes] | None = None

    def start_master(self) -> None:
        """Start the master, and wait until it answers."""
        self._master = subprocess.Popen(
            ["/usr/bin/rosmaster", "--core", "-p", str(self.port)],
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.tool("rosnode", "list", until_success=True)

    def stop_master(self) -> None:
        """End the master without a farewell."""
        if self._master is not None:
            self._master.kill()
            self._master.wait()
            self._master = None

    def program(
        self, node: str = "program", prefix: Sequence[str] = (), environment: Mapping[str, str] | None = None
    ) -> Program:
        """Start a `rospy` program in the namespace `/robot`, which ends with the test."""
        variables = {**self.environment, "ROS_NAMESPACE": "/robot", **(environment or {})}
        program = Program(
            "/usr/bin/python3",
            "tests.extensions.ros1.live.program",
            node,
            environment=variables,
            prefix=prefix,
        )
        self._programs.callback(program.close)
        program.run("")
        return program

    def start(self, *command: str) -> subprocess.Popen[str]:
        """Start a tool that ends with the test."""
        process = subprocess.Popen(
            command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self._programs.callback(_end, process)
        return process

    def tool(self, *command: str, until_success: bool = False) -> str:
        """Run a tool of ROS 1 and return its output.

        Raises:
            AssertionError: it fails.
        """
        for _ in range(_PATIENCE):
            done = subprocess.run(
                command, env=self.environment, capture_output=True, text=True, timeout=_PATIENCE, check=False
            )
            if done.returncode == 0 or not until_success:
                break
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    async def shows(self, words: set[str], *command: str) -> None:
        """Wait until the output of a tool contains words. The event loop goes on while the tool runs."""

        async def holds() -> bool:
            shown = await anyio.to_thread.run_sync(partial(self.tool, *command, until_success=True))
            return all(word in shown for word in words)

        await until_answered(holds, f"{' '.join(command)} does not show {', '.join(words)}")

    async def hides(self, word: str, *command: str) -> None:
        """Wait until the output of a tool does not contain a word."""

        async def holds() -> bool:
            return word not in await anyio.to_thread.run_sync(partial(self.tool, *command))

        await until_answered(holds, f"{' '.join(command)} shows {word}")

    def close(self) -> None:
        """End all programs."""
        self._programs.close()
        self.stop_master()


def serving(*arguments: str) -> AbstractContextManager[tuple[subprocess.Popen[str], str]]:
    """A command of this project that ROS 1 programs of this host reach, and the address that it prints."""
    environment = {"PYTHONPATH": os.environ.get("PYTHONPATH", ""), "ROS_IP": "127.0.0.1"}
    return running(*arguments, environment=environment, real=True, stderr=None)


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
    assert process.stdout is not None
    process.stdout.close()


@pytest.fixture
def ros(tmp_path: Path) -> Iterator[Ros]:
    """ROS 1 with a master of its own."""
    made = Ros(tmp_path)
    try:
        made.start_master()
        yield made
    finally:
        made.close()


@pytest.fixture
async def graph(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Ros1Graph]:
    """A graph that has joined the master."""
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    async with Ros1Graph(master=ros.uri) as joined:
        yield joined


@pytest.fixture(scope="session")
def relay(tmp_path_factory: pytest.TempPathFactory) -> Relay:
    """A program of roscpp for all types."""
    if not HAS_ROS:
        pytest.skip("needs ROS 1: run `make test-ros1`, which installs Debian's packages of it")
    include = Path("/usr/include")
    headers = (*include.glob("*_msgs/*.h"), *include.glob("actionlib/*.h"))
    # Not those of services and libraries.
    messages = (
        each
        for each in headers
        if f"\nstruct {each.stem}_\n" in each.read_text("utf-8")
        and not each.stem.endswith(("Request", "Response"))
    )
    types = sorted(f"{each.parent.name}/{each.stem}" for each in messages)
    return build_relay(tmp_path_factory.mktemp("relay"), (*types, *UNSEEN_TYPES))
