from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import anyio.to_thread
import pytest
import websockets
from websockets import Subprotocol

from rwt_client import connect
from tests.extensions.ros1.live.conftest import Ros, serving
from tests.extensions.ros1.live.test_topics import OTHER_STRING, PUBLISH, UNKNOWN
from tests.waiting import until

pytestmark = pytest.mark.anyio


@contextmanager
def server(ros: Ros, *options: str) -> Iterator[str]:
    """The URL of `rwt serve` on the graph of a master."""
    with serving("serve", "--graph", ros.uri, *options, "ws://127.0.0.1:0") as (_, url):
        yield url


async def test_clients_exchange_topics_and_calls_with_ros_1(ros: Ros) -> None:
    program = ros.program()
    program.run(UNKNOWN + "\nfrom std_msgs.msg import String\nheard = []")
    program.run("rospy.Subscriber('/from_client', String, lambda m: heard.append(m.data))")
    program.run("from std_srvs.srv import Trigger\nrospy.Service('/do', Trigger, lambda _: (True, 'done'))")
    with server(ros) as url:
        async with connect(url) as robot:
            await ros.shows({"rosapi"}, "rosservice", "list")
            values: list[Any] = []
            robot.subscribe("/strange", values.append, "never_seen/Outer")
            await until(lambda: values)
            assert values[0].inner[0].text == "a"
            publisher = robot.advertise("/from_client", "std_msgs/String")
            await publisher

            def arrived() -> bool:
                publisher.publish({"data": "hi"})
                return "hi" in program.run("result = heard")

            await until(arrived)
            response = await robot.call("/do", {}, "std_srvs/Trigger")
            assert response.message == "done"
            listed = await robot.call("/rosapi/nodes", {}, "rosapi/Nodes")
            assert "/robot/program" in listed.nodes
            details = await robot.call("/rosapi/message_details", {"type": "never_seen/Outer"})
            assert details.typedefs[0].fieldnames == ["number", "inner", "when"]
    assert ros.tool("rosnode", "list").split() == ["/robot/program"]
    assert "rosapi" not in ros.tool("rosservice", "list")


async def test_clients_are_notified_when_the_master_goes_and_returns(ros: Ros) -> None:
    with server(ros) as url:
        async with (
            websockets.connect(url) as rosbridge,
            websockets.connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as foxglove,
        ):
            await rosbridge.send('{"op": "set_level", "level": "warning"}')
            for change, text, levels in (
                (ros.stop_master, "The ROS 1 master does not answer", ("error", 2)),
                (ros.start_master, "The ROS 1 master answers", ("warning", 0)),
            ):
                await anyio.to_thread.run_sync(change)
                for client, level in zip((rosbridge, foxglove), levels, strict=True):
                    notice = await _next_status(client)
                    assert notice["level"] == level
                    assert text in str(notice)
            ros.program().run(PUBLISH.replace("queue_size=1000", "latch=True") + "publisher.publish('on')")
            await rosbridge.send('{"op": "subscribe", "topic": "/chatter", "type": "std_msgs/String"}')
            async for frame in rosbridge:
                if json.loads(frame).get("msg") == {"data": "on"}:
                    break


async def test_two_masters_are_bridged(ros: Ros, tmp_path: Path) -> None:
    with closing(Ros(tmp_path / "other")) as other:
        await anyio.to_thread.run_sync(other.start_master)
        first, second = ros.program("first"), other.program("second")
        with server(ros, "--graph", other.uri) as url:
            first.run(UNKNOWN + "from std_srvs.srv import Trigger")
            second.run(
                "from std_srvs.srv import Trigger\nrospy.Service('/do', Trigger, lambda _: (True, 'done'))"
            )
            second.run(UNKNOWN.split("publisher =")[0] + "got = []")
            second.run(
                "rospy.Subscriber('/strange', Outer, lambda message: got.append(plain(message.inner[1])))"
            )
            await until(lambda: second.run("result = got") == [{"text": "b", "pair": [0.0, -1.0]}])
            await ros.shows({"/do"}, "rosservice", "list")
            call = "plain(rospy.ServiceProxy('/do', Trigger)())"
            assert first.run(f"result = {call}") == {"success": True, "message": "done"}
            async with connect(url) as robot:
                response = await robot.call("/do", {}, "std_srvs/Trigger")
                assert response.message == "done"
        assert "rwt_bridge" not in ros.tool("rosnode", "list") + other.tool("rosnode", "list")


async def _next_status(client: websockets.ClientConnection) -> dict[str, Any]:
    async for text in client:
        message: dict[str, Any] = json.loads(text) if isinstance(text, str) else {}
        if message.get("op") == "status":
            return message
    raise AssertionError("the connection was closed")


async def test_a_client_uses_the_definition_of_the_robot(ros: Ros) -> None:
    program = ros.program()
    program.run(OTHER_STRING)
    with server(ros) as url:
        async with websockets.connect(url) as client:
            await client.send('{"op": "subscribe", "topic": "/commands", "type": "std_msgs/String"}')
            await until(lambda: program.run("result = commands.get_num_connections()") == 2)
            program.run("commands.publish(Other('back', 9))")
            assert json.loads(await client.recv())["msg"] == {"data": "back", "number": 9}
            await client.send('{"op": "set_level", "level": "error"}')
            await client.send('{"op": "advertise", "topic": "/new", "type": "never_seen/Thing"}')
            text = json.loads(await client.recv())["msg"]
            assert all(way in text for way in ("start that node", "--interfaces", "a standard type"))
            await client.send(
                '{"op": "publish", "topic": "/commands", "type": "std_msgs/String", "latch": true,'
                ' "msg": {"data": "go", "number": 3}}'
            )
            await until(lambda: program.run("result = received") == [["back", 9], ["go", 3]])
