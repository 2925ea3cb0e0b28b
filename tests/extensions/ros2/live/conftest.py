"""Tests against real ROS 2 programs: `make test-ros2`.

They are skipped where the real `rclpy` is not installed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import closing
from typing import TYPE_CHECKING

import pytest

from tests.extensions.ros2.live.domains import free_domain
from tests.statements import Program

if TYPE_CHECKING:
    from rwt.extensions.ros2 import Ros2Graph

try:
    from rclpy.impl import implementation_singleton as implementation_singleton
except ImportError:
    HAS_ROS = False
else:
    HAS_ROS = True


@pytest.fixture(scope="session", autouse=True)
def domain() -> int:
    """Domain of this run: runs at the same time do not meet. Only this machine is reached.

    Every test is skipped without ROS 2, before other fixtures import it.
    """
    if not HAS_ROS:
        pytest.skip("needs ROS 2: run `make test-ros2`, which installs its wheels")
    number = free_domain()
    os.environ.update(ROS_DOMAIN_ID=str(number), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    return number


@pytest.fixture
def program(domain: int) -> Iterator[Program]:
    """A ROS 2 program in another process, with the node `/robot/program`."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    with closing(
        Program(sys.executable, "tests.extensions.ros2.live.program", environment=environment)
    ) as running:
        yield running


@pytest.fixture(params=["callbacks", "thread"])
async def graph(request: pytest.FixtureRequest, domain: int) -> AsyncIterator[Ros2Graph]:
    """A graph that has joined ROS 2, with either way of waking the event loop."""
    from rwt.extensions.ros2 import Ros2Graph

    async with Ros2Graph(use_callbacks=request.param == "callbacks") as joined:
        yield joined
