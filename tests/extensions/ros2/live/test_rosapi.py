"""Services of rosapi about nodes of real ROS 2 programs, compared with the answers of `rclpy`."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Any

import pytest

from tests.extensions.ros2.live.program import NODE
from tests.waiting import until

if TYPE_CHECKING:
    from rwt_graph.nodes.node import Node
    from tests.statements import Program

pytestmark = pytest.mark.anyio

#: Two nodes with the same name in two namespaces, with endpoints of every kind.
_ROBOT = """
from rcl_interfaces.msg import ParameterDescriptor
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci
from rclpy.action import ActionServer
lasers = {}
for side in ('left', 'right'):
    lasers[side] = laser = rclpy.create_node('laser', namespace='/' + side)
    laser.create_publisher(LaserScan, 'scan', 10)
    laser.create_subscription(String, '/command', lambda m: None, 10)
    laser.create_service(Trigger, '~/reset', lambda request, response: response)
    laser.declare_parameter('range', 12.5)
    laser.declare_parameter('model', 'x1', ParameterDescriptor(read_only=True))
    executor.add_node(laser)
action = ActionServer(lasers['left'], Fibonacci, 'sweep', lambda goal: Fibonacci.Result())
"""
_LEAVE = """
action.destroy()
for laser in lasers.values():
    executor.remove_node(laser)
    laser.destroy_node()
"""
_NODES = """
result = sorted(namespace.rstrip('/') + '/' + name for name, namespace in node.get_node_names_and_namespaces()
                if not name.startswith('_'))
"""
_TOPICS = "result = {n: t for n, t in node.get_topic_names_and_types() if '/_' not in n}"
_SERVICES = "result = {n: t for n, t in node.get_service_names_and_types() if '/_' not in n}"


def _details(name: str, namespace: str) -> str:
    lists = {
        "publishing": "get_publisher_names_and_types_by_node",
        "subscribing": "get_subscriber_names_and_types_by_node",
        "services": "get_service_names_and_types_by_node",
    }
    of_node = f"('{name}', '{namespace}')"
    entries = [f"'{key}': sorted(n for n, _ in node.{ask}{of_node})" for key, ask in lists.items()]
    return f"result = {{{', '.join(entries)}}}"


@pytest.fixture
async def asker(domain: int, program: Program) -> AsyncIterator[Node]:
    """A node of a graph with rosapi, beside the robot."""
    from rwt.extensions.ros2 import Ros2Graph
    from rwt.rosapi import Rosapi

    program.run(_ROBOT)
    async with Ros2Graph() as graph:
        Rosapi(graph)
        node = graph.node("asker")
        sides, services = ("left", "right"), ("reset", "set_parameters")
        names = [f"/{side}/laser/{service}" for side in sides for service in services]
        await until(lambda: all(map(graph.service, names)) and graph.action("/left/sweep"))
        yield node


async def _ask(asker: Node, name: str, /, **request: object) -> Any:
    return await asker.call(f"/rosapi/{name}", request)


async def test_nodes_and_their_details(asker: Node, program: Program) -> None:
    await until(lambda: {"/rosapi", "/asker"} <= set(program.run(_NODES)))
    nodes = (await _ask(asker, "nodes")).nodes
    assert nodes == program.run(_NODES)
    assert {"/left/laser", "/right/laser", NODE} <= set(nodes)
    for side in ("/left", "/right"):
        details = await _ask(asker, "node_details", node=f"{side}/laser")
        known = program.run(_details("laser", side))
        assert {key: list(getattr(details, key)) for key in known} == known
    details = await _ask(asker, "node_details", node="/rosapi")
    known = program.run(_details("rosapi", "/"))
    assert list(details.publishing) == known["publishing"]
    # Also those whose packages are not installed here, such as rosapi_msgs.
    assert {"/rosapi/nodes", "/rosapi/get_param"} <= set(details.services)
    assert list(details.services) == known["services"]


async def test_topics_and_their_types(asker: Node, program: Program) -> None:
    await until(lambda: "/left/scan" in program.run(_TOPICS))
    answer = await _ask(asker, "topics")
    assert dict(zip(answer.topics, ([each] for each in answer.types), strict=True)) == program.run(_TOPICS)
    assert (await _ask(asker, "topic_type", topic="/right/scan")).type == "sensor_msgs/msg/LaserScan"
    found = await _ask(asker, "topics_for_type", type="sensor_msgs/msg/LaserScan")
    assert found.topics == ["/left/scan", "/right/scan"]
    assert (await _ask(asker, "publishers", topic="/left/scan")).publishers == ["/left/laser"]
    lasers = ["/left/laser", "/right/laser"]
    assert (await _ask(asker, "subscribers", topic="/command")).subscribers == lasers


async def test_services_and_their_types(asker: Node, program: Program) -> None:
    answer = await _ask(asker, "services")
    shown = {name for name in answer.services if not name.startswith("/rosapi/")}
    await until(lambda: shown == {name for name in program.run(_SERVICES) if not name.startswith("/rosapi/")})
    assert (await _ask(asker, "service_type", service="/left/laser/reset")).type == "std_srvs/srv/Trigger"
    assert (await _ask(asker, "service_node", service="/left/laser/reset")).node == "/left/laser"
    found = await _ask(asker, "services_for_type", type="std_srvs/srv/Trigger")
    assert found.services == ["/left/laser/reset", "/right/laser/reset"]
    providers = await _ask(asker, "service_providers", service="std_srvs/srv/Trigger")
    assert providers.providers == ["/left/laser", "/right/laser"]
    assert (await _ask(asker, "action_servers")).action_servers == ["/left/sweep"]
    assert (await _ask(asker, "action_type", action="/left/sweep")).type == "test_msgs/action/Fibonacci"


async def test_parameters(asker: Node, program: Program) -> None:
    names = (await _ask(asker, "get_param_names")).names
    assert {"/left/laser:range", "/right/laser:range", "/left/laser:use_sim_time"} <= set(names)
    assert (await _ask(asker, "get_param", name="/left/laser:range")).value == "12.5"
    assert (await _ask(asker, "has_param", name="/left/laser:missing")).exists is False
    assert (await _ask(asker, "set_param", name="/right/laser:range", value="7.5")).successful
    values = "result = [lasers[side].get_parameter('range').value for side in ('left', 'right')]"
    assert program.run(values) == [12.5, 7.5]
    refused = await _ask(asker, "set_param", name="/right/laser:model", value='"x2"')
    assert not refused.successful
    assert "read-only" in refused.reason


async def test_a_robot_that_leaves_is_listed_no_more(asker: Node, program: Program) -> None:
    program.run(_LEAVE)
    graph = asker.graph
    await until(lambda: not any(each.name.endswith("laser") for each in graph.nodes()))
    await until(lambda: graph.topic("/left/scan") is None and graph.service("/left/laser/reset") is None)
    assert "/left/laser" not in (await _ask(asker, "nodes")).nodes
    assert "/left/scan" not in (await _ask(asker, "topics")).topics
    assert (await _ask(asker, "service_type", service="/left/laser/reset")).type == ""


async def test_a_topic_whose_type_is_not_known_has_the_type_that_ros_2_reports(
    domain: int, program: Program
) -> None:
    from rwt.extensions.ros2 import Ros2Graph
    from rwt.rosapi import Rosapi
    from rwt_interfaces.registry import Registry

    program.run(
        "from test_msgs.msg import Builtins; publisher = node.create_publisher(Builtins, '/unknown', 10)"
    )
    async with Ros2Graph(Registry()) as graph:
        Rosapi(graph)
        asker = graph.node("asker")
        await until(lambda: graph.topic("/unknown"))
        answer = await _ask(asker, "topics")
        assert answer.types[answer.topics.index("/unknown")] == "test_msgs/msg/Builtins"
        assert (await _ask(asker, "topic_type", topic="/unknown")).type == "test_msgs/msg/Builtins"
        assert (await _ask(asker, "topics_for_type", type="test_msgs/Builtins")).topics == ["/unknown"]
