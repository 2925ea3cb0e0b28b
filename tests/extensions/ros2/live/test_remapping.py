"""Remapping rules, as ROS 2 programs see their effect."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from websockets.sync.client import connect

from rwt_graph.errors import Ros2Error
from tests.extensions.ros2.live.test_server import serving
from tests.waiting import until

if TYPE_CHECKING:
    from tests.statements import Program

pytestmark = pytest.mark.anyio


async def test_the_server_starts_with_remapping_rules(program: Program) -> None:
    program.run(
        """
from geometry_msgs.msg import Twist
received = []
node.create_subscription(Twist, '/input/cmd_vel', lambda m: received.append(m.linear.x), 10)
"""
    )
    rules = ("/cmd_vel:=/input/cmd_vel", "__ns:=/robot1", "__node:=bridge", "rosapi:__node:=api")
    arguments = [part for rule in rules for part in ("-r", rule)]
    parameters = ("-p", "port:=0", "-p", "address:=127.0.0.1")
    twist = {"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"x": 0.5}}}
    with serving("ros2", "serve", "--ros-args", *parameters, *arguments) as (_, url), connect(url) as client:
        client.send(json.dumps({"op": "advertise", "topic": "/cmd_vel", "type": "geometry_msgs/Twist"}))
        nodes = "result = [n for n, space in node.get_node_names_and_namespaces() if space == '/robot1']"
        await until(lambda: {"bridge", "api"} <= set(program.run(nodes)))

        def arrived() -> bool:
            client.send(json.dumps(twist))
            return 0.5 in program.run("result = received")

        await until(arrived)
        assert program.run("result = node.count_publishers('/cmd_vel')") == 0


async def _turn(goal: object) -> None:
    """Execute a goal that is never sent."""


async def test_services_and_actions_are_remapped(domain: int, program: Program) -> None:
    from rwt.extensions.ros2 import Ros2Graph

    program.run(
        """
from std_srvs.srv import Trigger
node.create_service(Trigger, '/arm/reset', lambda _, response: Trigger.Response(message='arm'))
"""
    )
    async with Ros2Graph(remap=("/reset:=/arm/reset", "turn:=/arm/turn", "__ns:=/left")) as graph:
        ours = graph.node("ours")
        assert ours.name == "/left/ours"
        await until(lambda: graph.service("/reset"))
        assert (await ours.call("/reset")).message == "arm"
        ours.advertise_action("/turn", "test_msgs/Fibonacci", _turn)
        assert [each.name for each in graph.actions()] == ["/arm/turn"]
        await until(lambda: program.run("result = node.count_publishers('/arm/turn/_action/status')"))
        names = "result = [name for name, _ in node.get_service_names_and_types_by_node('ours', '/left')]"
        await until(lambda: "/left/ours/get_parameters" in program.run(names))


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        ("/cmd_vel", "expected OLD:=NEW"),
        ("/a b:=/c", "not a valid name"),
        ("rosapi:/a:=/b", "rules for one node can only change its name"),
        ("__node:=x", "name the node to rename: NODE:__node:=x"),
        ("rosapi:__node:=/a/b", "a node's name has no namespace"),
    ],
)
def test_invalid_rules_are_rejected(domain: int, rule: str, text: str) -> None:
    from rwt.extensions.ros2 import Ros2Graph

    with pytest.raises(Ros2Error, match=text):
        Ros2Graph(remap=(rule,))
