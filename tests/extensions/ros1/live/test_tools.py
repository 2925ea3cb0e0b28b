"""Debian's tools and libraries of ROS 1 against a node of this process, with either master."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import anyio
import anyio.to_thread
import pytest

from tests.extensions.ros1.live.conftest import Ros, serving
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros1 import Ros1Graph

pytestmark = pytest.mark.anyio


@pytest.fixture(params=["rosmaster", "rwt master"])
def ros(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Ros]:
    """ROS 1 with its own master, or with `rwt master` in place of it."""
    with closing(Ros(tmp_path)) as made:
        if request.param == "rosmaster":
            made.start_master()
            yield made
            return
        with serving("master", f"127.0.0.1:{made.port}"):
            yield made


@pytest.fixture
async def robot(ros: Ros, graph: Ros1Graph) -> AsyncIterator[list[str]]:
    """The node `/talker`, which publishes ten times a second on `/chatter`; what it hears on `/commands`."""
    node = graph.node("talker")
    publisher = node.advertise("/chatter", "std_msgs/String")
    heard: list[str] = []
    node.subscribe("/commands", lambda message: heard.append(message.data), "std_msgs/String")
    node.create_timer(0.1, lambda: publisher.publish({"data": "tick"}))
    await ros.shows({"/chatter", "/commands"}, "rostopic", "list")
    yield heard


async def _tool(ros: Ros, *command: str) -> str:
    return await anyio.to_thread.run_sync(partial(ros.tool, *command))


@pytest.mark.usefixtures("robot")
async def test_rostopic(ros: Ros, robot: list[str]) -> None:
    assert (await _tool(ros, "rostopic", "echo", "-n", "2", "/chatter")).count('data: "tick"') == 2
    info = await _tool(ros, "rostopic", "info", "/chatter")
    assert "Type: std_msgs/String" in info
    assert "/talker" in info
    ros.start("rostopic", "pub", "-r", "10", "/commands", "std_msgs/String", "data: go")
    await until(lambda: "go" in robot)
    measured = ros.start("timeout", "-s", "INT", "6", "rostopic", "hz", "/chatter")
    rate = (await anyio.to_thread.run_sync(measured.communicate))[0]
    assert "average rate: " in rate


@pytest.mark.usefixtures("robot")
async def test_rosnode(ros: Ros, graph: Ros1Graph, caplog: pytest.LogCaptureFixture) -> None:
    assert "/talker" in await _tool(ros, "rosnode", "list")
    assert "xmlrpc reply" in await _tool(ros, "rosnode", "ping", "-c", "1", "/talker")
    info = await _tool(ros, "rosnode", "info", "/talker")
    assert "* /chatter [std_msgs/String]" in info
    assert "* /talker/get_loggers" in info
    assert "killed" in await _tool(ros, "rosnode", "kill", "/talker")
    await ros.hides("/talker", "rosnode", "list")
    assert "leaves ROS 1" in caplog.text
    assert graph.topic("/chatter") is not None


async def test_rosservice(ros: Ros, graph: Ros1Graph) -> None:
    graph.node("server").advertise_service(
        "/switch", "std_srvs/SetBool", lambda request: {"success": request.data, "message": "switched"}
    )
    await ros.shows({"/switch"}, "rosservice", "list")
    info = await _tool(ros, "rosservice", "info", "/switch")
    assert "Node: /server" in info
    assert "Type: std_srvs/SetBool" in info
    assert "rosrpc://127.0.0.1:" in await _tool(ros, "rosservice", "uri", "/switch")
    assert "/switch" in await _tool(ros, "rosservice", "find", "std_srvs/SetBool")
    called = await _tool(ros, "rosservice", "call", "/switch", "true")
    assert called.split("\n")[:2] == ["success: True", 'message: "switched"']


async def test_rosparam(ros: Ros, graph: Ros1Graph) -> None:
    tree = graph.parameters
    tree.set("/ours/gains", {"p": 1.5, "names": ["a", "b"]})
    await ros.shows({"/ours/gains/p"}, "rosparam", "list")
    assert "1.5" in await _tool(ros, "rosparam", "get", "/ours/gains/p")
    await _tool(ros, "rosparam", "set", "/ours/gains/p", "2.5")
    await until(lambda: tree.get("/ours/gains/p") == 2.5)
    await _tool(ros, "rosparam", "delete", "/ours/gains")
    await until(lambda: not tree.has("/ours/gains"))


@pytest.mark.usefixtures("robot")
async def test_rosbag(ros: Ros, robot: list[str], tmp_path: Path) -> None:
    bag = str(tmp_path / "a.bag")
    await _tool(ros, "rosbag", "record", "--duration", "3", "-O", bag, "/chatter")
    assert "std_msgs/String" in await _tool(ros, "rosbag", "info", bag)
    await _tool(ros, "rosbag", "play", "--quiet", bag, "/chatter:=/commands")
    await until(lambda: "tick" in robot)


@pytest.mark.usefixtures("robot")
async def test_roswtf_finds_no_error(ros: Ros) -> None:
    _, _, found = (await _tool(ros, "roswtf")).partition("Beginning tests of your ROS graph")
    assert "running graph rules" in found
    assert "ERROR" not in found
    assert "The following node subscriptions are unconnected:\n * /talker:\n   * /commands\n" in found


LISTENER = """
import tf2_ros
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer)
def x(target, source):
    found = buffer.lookup_transform(target, source, rospy.Time(0), rospy.Duration(20))
    return found.transform.translation.x
"""


async def test_a_tf2_listener_hears_this_process(ros: Ros, graph: Ros1Graph) -> None:
    node = graph.node("arm")

    def transform(parent: str, child: str, x: float) -> dict[str, object]:
        header = {"stamp": graph.distro.time(graph.clock.time_ns()), "frame_id": parent}
        parts = {"translation": {"x": x}, "rotation": {"w": 1.0}}
        return {"transforms": [{"header": header, "child_frame_id": child, "transform": parts}]}

    static = node.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True)
    static.publish(transform("map", "base", 2.5))
    moving = node.advertise("/tf", "tf2_msgs/TFMessage")
    node.create_timer(0.05, lambda: moving.publish(transform("base", "hand", 0.5)))
    program = await anyio.to_thread.run_sync(ros.program)
    ask = partial(program.run, LISTENER + "result = [x('map', 'base'), x('base', 'hand'), x('map', 'hand')]")
    assert await anyio.to_thread.run_sync(ask) == [2.5, 0.5, 3.0]


async def test_unreliable_transport_is_refused(ros: Ros, graph: Ros1Graph) -> None:
    node = graph.node("talker")
    node.advertise("/chatter", "std_msgs/String")
    await ros.shows({"/chatter"}, "rostopic", "list")
    program = await anyio.to_thread.run_sync(ros.program)
    ask = """
import rosgraph, xmlrpc.client
uri = rosgraph.Master('/program').lookupNode('/talker')
protocols = [['UDPROS', b'', '127.0.0.1', 5000, 1500]]
with xmlrpc.client.ServerProxy(uri) as talker:
    result = [talker.requestTopic('/program', '/chatter', each)[:2]
              for each in (protocols, [*protocols, ['TCPROS']])]
"""
    assert await anyio.to_thread.run_sync(program.run, ask) == [[0, "only TCPROS is supported"], [1, "ready"]]
