"""Parameters, log and time of nodes."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import pytest

from tests.extensions.ros2.live.program import NODE
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros2 import Ros2Graph
    from tests.statements import Program

pytestmark = pytest.mark.anyio


async def test_a_node_that_does_not_answer_is_left_out(
    graph: Ros2Graph, program: Program, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rwt_graph.parameters.client.ANSWER_TIMEOUT", 0.3)
    ours = graph.node("ours")
    program.run("silent = rclpy.create_node('silent')")  # No executor runs it.
    await until(lambda: graph.service("/silent/list_parameters"))
    await until(lambda: graph.service(f"{NODE}/list_parameters"))
    with caplog.at_level(logging.WARNING):
        names = await ours.params.names()
    program.run("silent.destroy_node()")
    assert "/ours:use_sim_time" in names
    assert not [name for name in names if name.startswith("/silent:")]
    assert "the parameters of node /silent are not listed" in caplog.text


async def test_ros_2_reads_and_sets_our_parameters(graph: Ros2Graph, program: Program) -> None:
    ours = graph.node("ours", "/fleet")
    ours.parameters.declare("speed", 1.5)
    program.run(
        """
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
parameters = AsyncParameterClient(node, '/fleet/ours')
"""
    )
    await until(lambda: program.run("result = parameters.services_are_ready()"))

    async def ask(call: str, result: str) -> Any:
        program.run(f"future = parameters.{call}")
        await until(lambda: program.run("result = future.done()"))
        return program.run(f"result = {result}")

    assert "speed" in await ask("list_parameters()", "list(future.result().result.names)")
    assert await ask("get_parameters(['speed'])", "future.result().values[0].double_value") == 1.5
    setting = "set_parameters([Parameter('speed', value=2.5)])"
    assert await ask(setting, "future.result().results[0].successful")
    assert ours.parameters.get("speed") == 2.5


async def test_nodes_with_one_name_are_one_node_of_ros_2(graph: Ros2Graph, program: Program) -> None:
    names = "result = [name for name in node.get_node_names() if name == 'twice']"
    first, second = graph.node("twice"), graph.node("twice")
    await until(lambda: program.run(names))
    assert program.run(names) == ["twice"]
    first.close()
    second.advertise("/said", "std_msgs/String")
    await until(lambda: program.run("result = node.count_publishers('/said')") == 1)
    assert program.run(names) == ["twice"]
    second.close()
    await until(lambda: not program.run(names))


async def test_logs_reach_rosout(graph: Ros2Graph, program: Program) -> None:
    program.run(
        """
from rcl_interfaces.msg import Log
lines = []
node.create_subscription(Log, '/rosout', lambda m: lines.append([m.name, m.level, m.msg]), 100)
"""
    )
    ours = graph.node("ours", "/fleet")
    heard: list[str] = []
    ours.subscribe("/rosout", lambda message: heard.append(message.msg), "rcl_interfaces/Log")

    def arrived() -> bool:
        ours.log.warning("ours")
        return ["fleet.ours", 30, "ours"] in program.run("result = lines")

    await until(arrived)
    await until(lambda: program.run("node.get_logger().error('theirs')") or "theirs" in heard)


async def test_ros_time_follows_the_topic_clock(domain: int, program: Program) -> None:
    from rwt.extensions.ros2 import Ros2Graph

    program.run(
        """
from rosgraph_msgs.msg import Clock
from builtin_interfaces.msg import Time
clock = node.create_publisher(Clock, '/clock', qos.qos_profile_sensor_data)
timer = node.create_timer(0.02, lambda: clock.publish(Clock(clock=Time(sec=5, nanosec=7))))
"""
    )
    async with Ros2Graph(use_sim_time=True) as graph:
        node = graph.node("ours")
        assert node.parameters.get("use_sim_time") is True
        await until(lambda: graph.clock.time_ns() == 5_000_000_007)
        assert not any("clock" in each.name for each in graph.nodes())
