"""What a restarted program of rclpy offers comes back at every restart."""

from __future__ import annotations

import os
import sys
from contextlib import closing
from typing import TYPE_CHECKING, Final

import anyio.to_thread
import pytest

from rwt_participant.errors import CallFailed
from tests.extensions.ros2.live.program import NODE
from tests.statements import Program
from tests.waiting import until, until_answered

if TYPE_CHECKING:
    from rwt.extensions.ros2 import Ros2Graph

pytestmark = pytest.mark.anyio

RESTARTS: Final = 3

_OFFER: Final = """
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci
from rclpy.action import ActionServer
number = {number}
def serve(request, response):
    response.message = str(number)
    return response
service = node.create_service(Trigger, '/fast', serve)
out = node.create_publisher(String, '/out', 10)
heard = node.create_subscription(String, '/in', lambda _: None, 10)
action = ActionServer(node, Fibonacci, '/count', lambda goal: None)
"""


def _is_back(graph: Ros2Graph) -> bool:
    out, heard = graph.topic("/out"), graph.topic("/in")
    return (
        out is not None
        and NODE in [each.node for each in out.publishers]
        and heard is not None
        and NODE in [each.node for each in heard.subscribers]
        and graph.service("/fast") is not None
        and graph.action("/count") is not None
    )


@pytest.mark.parametrize("how", ["stopped", "killed"])
async def test_every_kind_of_endpoint_comes_back(graph: Ros2Graph, domain: int, how: str) -> None:
    from rwt_graph.nodes.node import Node

    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    caller = Node(graph, "caller")
    for number in range(RESTARTS):
        with closing(
            Program(sys.executable, "tests.extensions.ros2.live.program", environment=environment)
        ) as robot:
            await anyio.to_thread.run_sync(robot.run, _OFFER.format(number=number))
            await until(lambda: _is_back(graph))

            async def is_answered(expected: str = str(number)) -> bool:
                try:
                    response = await caller.call("/fast", {}, timeout=1)
                except CallFailed:
                    return False  # Only the one that was killed was known, which stays listed.
                return bool(response.message == expected)

            await until_answered(is_answered)
            if how == "killed":
                robot.kill()
        if how == "stopped":
            await until(lambda: graph.service("/fast") is None and graph.action("/count") is None)
