"""`ros-mcp` of PyPI, a server of the Model Context Protocol that translates to rosbridge, uses this server as
any rosbridge client does.

It needs an older SDK than the project's own gateway, and so an environment of its own: the test runs where
its command is on the path, or where ROS_MCP names it.
"""

from __future__ import annotations

import os
import shutil
from typing import Any

import pytest
from mcp.client import Client
from mcp.client.stdio import StdioServerParameters, stdio_client
from mcp_types import TextContent

from rwt import Server

COMMAND = os.environ.get("ROS_MCP") or shutil.which("ros-mcp")

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.clients,
    pytest.mark.timeout(120),
    pytest.mark.skipif(COMMAND is None, reason="needs the command ros-mcp, from an environment of its own"),
]

CALLS: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("get_topics", {}, "/battery_state"),
    ("get_services", {}, "/add_two_ints"),
    ("get_actions", {}, "/fibonacci"),
    ("get_nodes", {}, "/demo_robot"),
    ("detect_ros_version", {}, "jazzy"),
    ("get_topic_type", {"topic": "/odom"}, "nav_msgs/msg/Odometry"),
    ("get_topic_details", {"topic": "/cmd_vel"}, "/demo_robot"),
    ("get_message_details", {"message_type": "geometry_msgs/Twist"}, "geometry_msgs/Vector3"),
    ("get_service_type", {"service": "/add_two_ints"}, "example_interfaces/srv/AddTwoInts"),
    ("get_service_details", {"service": "/add_two_ints"}, "int64"),
    ("subscribe_once", {"topic": "/odom", "msg_type": "nav_msgs/Odometry"}, "twist"),
    (
        "subscribe_for_duration",
        {"topic": "/odom", "msg_type": "nav_msgs/Odometry", "duration": 1.0, "max_messages": 3},
        '"collected_count": 3',
    ),
    (
        "publish_once",
        {"topic": "/cmd_vel", "msg_type": "geometry_msgs/Twist", "msg": {"linear": {"x": 0.1}}},
        '"success":true',
    ),
    (
        "call_service",
        {
            "service_name": "/add_two_ints",
            "service_type": "example_interfaces/AddTwoInts",
            "request": {"a": 1, "b": 2},
        },
        '"sum":3',
    ),
    ("get_parameters", {"node_name": "/demo_robot"}, "/demo_robot:max_speed"),
    ("get_parameter", {"name": "/demo_robot:max_speed"}, '"0.8"'),
    ("set_parameter", {"name": "/demo_robot:max_speed", "value": "0.6"}, '"successful":true'),
    (
        "send_action_goal",
        {
            "action_name": "/fibonacci",
            "action_type": "example_interfaces/Fibonacci",
            "goal": {"order": 3},
            "timeout": 10,
        },
        '"sequence":[0,1,1,2]',
    ),
)


async def test_its_tools_do_what_they_say() -> None:
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        port = server.urls[0].rpartition(":")[2]
        where = {"ROSBRIDGE_IP": "127.0.0.1", "ROSBRIDGE_PORT": port}
        assert COMMAND is not None
        command = StdioServerParameters(
            command=COMMAND, args=["--transport", "stdio"], env={**os.environ, **where}
        )
        async with Client(stdio_client(command), mode="legacy") as agent:
            await agent.call_tool("connect_to_robot", {"ip": "127.0.0.1", "port": int(port)})
            for tool, arguments, expected in CALLS:
                for _ in range(3):
                    result = await agent.call_tool(tool, arguments)
                    text = "".join(part.text for part in result.content if isinstance(part, TextContent))
                    # It hears nothing more once it has waited half a second for a message.
                    if "Timeout waiting for message" not in text:
                        break
                assert expected in text, (tool, text[:500])
