"""A robot of ROS 2 Humble: a participant of Debian's CycloneDDS 0.10, which announces no type hashes.

Skipped without Debian's packages cyclonedds-dev, cyclonedds-tools and gcc.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import anyio.to_thread
import pytest

from rwt_graph.nodes.node import Node
from rwt_interfaces import HUMBLE, Registry
from tests.waiting import until

pytestmark = pytest.mark.anyio

SOURCES = Path(__file__).parent / "humble"


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The participant, built."""
    if shutil.which("idlc") is None or shutil.which("gcc") is None:
        pytest.skip("needs Debian's packages cyclonedds-dev, cyclonedds-tools and gcc")
    folder = tmp_path_factory.mktemp("humble")
    subprocess.run(
        ["idlc", "-t", SOURCES / "Types.idl"], cwd=folder, check=True
    )  # As Humble: no type objects.
    built = folder / "participant"
    sources = [str(SOURCES / "participant.c"), str(folder / "Types.c")]
    options = [f"-I{folder}", "-I/usr/include/x86_64-linux-gnu", "-lddsc", "-Wl,--allow-shlib-undefined"]
    subprocess.run(["gcc", *sources, "-o", str(built), *options], check=True)
    return built


@pytest.fixture
def robot(program: Path, domain: int) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen([program, str(domain)], stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


async def test_messages_of_humble_pass_both_ways(
    robot: subprocess.Popen[str], domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rwt.extensions.ros2 import Ros2Graph

    # With LOCALHOST, Fast DDS ignores the participants of other vendors.
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    async with Ros2Graph(Registry(HUMBLE), domain=domain) as graph:
        node = Node(graph, "server")
        ranges: list[Any] = []
        node.subscribe("/range", ranges.append)
        words = node.advertise("/words", "std_msgs/String", latch=True)
        words.publish({"data": "from the server"})
        await until(lambda: ranges)
        found = ranges[0]
        assert (found.header.frame_id, found.min_range, found.max_range, found.range) == (
            "sonar",
            0.25,
            4,
            1.5,
        )
        assert not hasattr(found, "variance")  # Jazzy's.
        assert robot.stdout is not None
        async with anyio.create_task_group() as group:
            heard: list[str] = []

            async def listen() -> None:
                assert robot.stdout is not None
                heard.append(await anyio.to_thread.run_sync(robot.stdout.readline))

            group.start_soon(listen)
            while not heard:
                words.publish({"data": "from the server"})
                await anyio.sleep(0.1)
        assert heard == ["from the server\n"]
