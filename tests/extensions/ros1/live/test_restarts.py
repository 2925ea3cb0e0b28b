"""Nodes of rospy that are started again, as on a robot in use; `../test_restarts.py` has more of them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

import anyio.to_thread
import pytest

from tests.extensions.ros1.live.test_services import OFFER
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros1 import Ros1Graph
    from tests.extensions.ros1.live.conftest import Ros
    from tests.statements import Program

pytestmark = pytest.mark.anyio

RESTARTS: Final = 4

TOPIC: Final = """
from std_msgs.msg import String
out = rospy.Publisher('/out', String, latch=True, queue_size=1)
heard = rospy.Subscriber('/in', String)
"""


async def _started(ros: Ros, node: str = "program") -> Program:
    program = await anyio.to_thread.run_sync(partial(ros.program, node))
    await anyio.to_thread.run_sync(program.run, OFFER + TOPIC)
    return program


def _is_back(graph: Ros1Graph, node: str) -> bool:
    service, topic, heard = graph.service("/switch"), graph.topic("/out"), graph.topic("/in")
    return (
        service is not None
        and service.node == node
        and graph.service("/slow") is not None
        and topic is not None
        and [each.node for each in topic.publishers] == [node]
        and heard is not None
        and bool(heard.subscribers)
    )


@pytest.mark.parametrize("how", ["stopped", "killed"])
async def test_what_rospy_offers_comes_back(ros: Ros, graph: Ros1Graph, how: str) -> None:
    for _ in range(RESTARTS):
        program = await _started(ros)
        await until(lambda: _is_back(graph, "/robot/program"))
        response = await graph.node("caller").call("/switch", {"data": True})
        assert response.message == "switched"
        await anyio.to_thread.run_sync(program.close if how == "stopped" else program.kill)
        if how == "stopped":
            await until(lambda: graph.service("/switch") is None and graph.topic("/out") is None)


async def test_two_nodes_of_rospy_that_offer_one_service_in_turn(ros: Ros, graph: Ros1Graph) -> None:
    for _ in range(RESTARTS // 2):
        for node in ("first", "second"):
            program = await _started(ros, node)
            await until(partial(_is_back, graph, f"/robot/{node}"))
            await anyio.to_thread.run_sync(program.close)
