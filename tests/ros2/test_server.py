from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from rwt_client import connect
from tests.processes import running
from tests.waiting import until

if TYPE_CHECKING:
    from tests.ros2.program import Program

pytestmark = pytest.mark.anyio


async def test_a_client_exchanges_topics_with_a_ros_2_program(program: Program) -> None:
    program.run(
        """
from std_msgs.msg import String
received = []
node.create_subscription(String, '/from_client', lambda m: received.append(m.data), 10)
kept = qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
publisher = node.create_publisher(String, '/to_client', kept)
publisher.publish(String(data='retained'))
"""
    )
    environment = {"PYTHONPATH": os.environ.get("PYTHONPATH", "")}
    arguments = ("serve", "--graph", "ros2", "ws://127.0.0.1:0")
    with running(*arguments, environment=environment, real=True, stderr=None) as (_, url):
        async with connect(url) as robot:
            texts: list[str] = []
            robot.subscribe("/to_client", lambda message: texts.append(message.data), "std_msgs/String")
            await until(lambda: texts == ["retained"])
            late: list[str] = []
            robot.subscribe("/to_client", lambda message: late.append(message.data), "std_msgs/String")
            await until(lambda: late == ["retained"])
            publisher = robot.advertise("/from_client", "std_msgs/String")
            await publisher
            await until(lambda: program.run("result = node.count_publishers('/from_client')") == 1)

            def arrived() -> bool:
                publisher.publish({"data": "hi"})
                return "hi" in program.run("result = received")

            await until(arrived)
    await until(lambda: program.run("result = node.count_publishers('/from_client')") == 0)
