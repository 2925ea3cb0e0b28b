"""This project's master in place of ROS 1's: `rwt serve --graph ros1-master://…`, and real programs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from rwt_client import connect
from tests.extensions.ros1.live.conftest import Ros, serving
from tests.extensions.ros1.live.test_actions import CLIENT, SERVER
from tests.extensions.ros1.live.test_services import CALL, OFFER
from tests.waiting import until, until_answered, wait_until

if TYPE_CHECKING:
    from tests.statements import Program

pytestmark = pytest.mark.anyio


@pytest.fixture
def core(tmp_path: Path) -> Iterator[tuple[Ros, str]]:
    """ROS 1 whose master is a server of this project, and the URL of the server."""
    ros = Ros(tmp_path)
    graph = ros.uri.replace("ros1:", "ros1-master:")
    with serving("serve", "--graph", graph, "ws://127.0.0.1:0") as (_, url):
        try:
            yield ros, url
        finally:
            ros.close()


def test_the_command_serves_programs_alone(tmp_path: Path) -> None:
    ros = Ros(tmp_path)
    address = f"127.0.0.1:{ros.port}"
    with serving("master", address) as (_, uri):
        try:
            assert uri == f"http://{address}/"
            assert ros.tool("rosnode", "list").split() == ["/rosout"]
        finally:
            ros.close()


def test_private_names_and_the_search_for_parameters(core: tuple[Ros, str]) -> None:
    ros, _ = core
    program = ros.program()
    ros.tool("rosparam", "set", "/a/b", "[1, two, {c: 2.5}]")
    assert ros.tool("rosparam", "get", "/a").split() == ["b:", "-", "1", "-", "two", "-", "c:", "2.5"]
    assert "noetic" in ros.tool("rosparam", "get", "/rosdistro")
    program.run("rospy.set_param('~own', 1); rospy.set_param('/robot/near', 2)")
    assert program.run("result = [rospy.search_param('near'), rospy.get_param('~own')]") == ["/robot/near", 1]
    assert "killed" in ros.tool("rosnode", "kill", "/robot/program")
    wait_until(lambda: "/robot/program" not in ros.tool("rosnode", "list"))


async def test_programs_and_clients_of_the_server_meet(core: tuple[Ros, str]) -> None:
    ros, url = core
    server, client = ros.program("server"), ros.program("client")
    server.run(SERVER)
    assert client.run(CLIENT.format(goal=21)) is True
    client.run("client.wait_for_result(rospy.Duration(20))")
    assert client.run("result = client.get_result().result") == 42
    _use_tf(server, client)
    async with connect(url) as robot:
        server.run(OFFER)
        client.run(CALL)
        assert client.run("result = ask(True)")["message"] == "switched"
        server.run(
            "from std_msgs.msg import String; out = rospy.Publisher('/out', String, latch=True, queue_size=1)"
        )
        server.run("out.publish('hi')")
        values: list[Any] = []
        robot.subscribe("/out", values.append, "std_msgs/String")
        await until(lambda: values)

        async def is_listed() -> bool:
            return "/robot/server" in (await robot.call("/rosapi/nodes", {}, "rosapi/Nodes")).nodes

        await until_answered(is_listed)  # The tables are read every second.
        # A second node of the name makes the first one leave.
        second = ros.program("client")
        await until(lambda: client.run("result = rospy.is_shutdown()"))
        assert second.run("result = rospy.is_shutdown()") is False


def _use_tf(server: Program, client: Program) -> None:
    server.run(
        """
import tf2_ros, geometry_msgs.msg
broadcaster = tf2_ros.StaticTransformBroadcaster()
transform = geometry_msgs.msg.TransformStamped()
transform.header.frame_id, transform.child_frame_id = 'map', 'base'
transform.transform.translation.x, transform.transform.rotation.w = 2.5, 1.0
broadcaster.sendTransform(transform)
"""
    )
    client.run("import tf2_ros; buffer = tf2_ros.Buffer(); listener = tf2_ros.TransformListener(buffer)")
    found = "buffer.lookup_transform('map', 'base', rospy.Time(0), rospy.Duration(20))"
    assert client.run(f"result = {found}.transform.translation.x") == 2.5
