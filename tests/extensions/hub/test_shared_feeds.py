"""Viewers of a robot's server through a hub: what they get, and what crosses the uplink for them."""

from __future__ import annotations

import json
import struct
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from urllib.request import urlopen

import anyio
import msgspec
import pytest
from anyio import to_thread
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from rwt import Node, Server
from rwt.extensions.hub.hub import Hub, open_hub
from rwt_participant.qos import LATCHED
from rwt_transports import Limits
from tests.waiting import until

pytestmark = pytest.mark.anyio

FOXGLOVE = Subprotocol("foxglove.sdk.v1")


@dataclass
class Fleet:
    """A hub, and the server of a robot that has dialled in."""

    hub: Hub
    server: Server
    node: Node

    @property
    def received(self) -> int:
        """Bytes that the hub has received from the robot."""
        (robot,) = self.hub.robots
        assert robot.carrier is not None
        return robot.carrier.sink.received


@asynccontextmanager
async def fleet(limits: Limits | None = None, **others: Any) -> AsyncIterator[Fleet]:
    async with open_hub("ws://127.0.0.1:0", limits=limits) as hub:
        server = Server("ws://127.0.0.1:0", dial={"urls": [f"{hub.url}/robots/rosie"]}, nodes=(), **others)
        async with server:
            await until(lambda: hub.robots)
            yield Fleet(hub, server, server.node("robot"))


@dataclass
class Viewer:
    """Client that keeps its messages.

    Attributes:
        published: `msg` of each `publish`, by topic.
        others: its other messages.
    """

    link: ClientConnection
    published: dict[str, list[Any]] = field(default_factory=dict)
    others: list[Any] = field(default_factory=list)

    def data(self, topic: str) -> list[Any]:
        """Return the field `data` of each message."""
        return [message["data"] for message in self.published.get(topic, ())]

    async def read(self) -> None:
        async for said in self.link:
            op = json.loads(said)
            if op["op"] == "publish":
                self.published.setdefault(op["topic"], []).append(op["msg"])
            else:
                self.others.append(op)

    async def heard(self, count: int) -> None:
        """Wait for so many messages that are not of a topic."""
        await until(lambda: len(self.others) >= count)

    async def say(self, **op: object) -> None:
        await self.link.send(json.dumps(op))


@asynccontextmanager
async def viewer(url: str, *subscriptions: Mapping[str, object]) -> AsyncIterator[Viewer]:
    async with connect(url) as link, anyio.create_task_group() as tasks:
        found = Viewer(link)
        tasks.start_soon(found.read)
        for subscription in subscriptions:
            await found.say(op="subscribe", type="std_msgs/String", **subscription)
        await found.say(op="call_service", service="/rosapi/get_time", id="ready")
        await found.heard(1)
        yield found
        tasks.cancel_scope.cancel()


def path(fleet: Fleet) -> str:
    return f"{fleet.hub.url}/rosie"


@asynccontextmanager
async def viewers(fleet: Fleet, count: int, **subscription: object) -> AsyncIterator[list[Viewer]]:
    async with AsyncExitStack() as stack:
        yield [
            await stack.enter_async_context(viewer(path(fleet), {"topic": "/odom", **subscription}))
            for _ in range(count)
        ]


async def heard(viewers: Sequence[Viewer], count: int) -> None:
    """Wait until each has so many messages."""
    await until(lambda: all(len(each.data("/odom")) == count for each in viewers))


async def test_twenty_viewers_cost_the_uplink_what_one_costs() -> None:
    async with fleet() as robot:
        odometry = robot.node.advertise("/odom", "std_msgs/String")
        costs = []
        for count in (1, 20):
            async with viewers(robot, count) as watching:
                before = robot.received
                for number in range(50):
                    odometry.publish({"data": f"{number} ".ljust(2000)})
                    await heard(watching, number + 1)
                costs.append(robot.received - before)
                for each in watching:
                    assert [int(data) for data in each.data("/odom")] == list(range(50))
        assert costs[1] <= 1.05 * costs[0]


async def test_each_encoding_and_spelling_in_use_crosses_once() -> None:
    async with fleet() as robot:
        odometry = robot.node.advertise("/odom", "std_msgs/String")
        async with (
            viewers(robot, 2),
            viewers(robot, 2, compression="png") as png,
            viewer(path(robot), {"topic": "odom"}) as relative,
            connect(robot.hub.url + "/rosie", subprotocols=[FOXGLOVE]) as foxglove,
        ):
            channel = await _channel(foxglove, "/odom")
            for subscription in (1, 2):
                wish = {"id": subscription + 40, "channelId": channel}
                if subscription == 1:
                    await foxglove.send(json.dumps({"op": "subscribe", "subscriptions": [wish]}))
            await until(lambda: len(robot.hub.robots[0].feeds) == 4)
            odometry.publish({"data": "x"})
            data = await _message(foxglove)
            assert struct.unpack("<BI", data[:5]) == (1, 41)
            await until(lambda: relative.data("odom") == ["x"])
            await until(lambda: all(each.others[-1]["op"] == "png" for each in png))


async def _channel(client: ClientConnection, topic: str) -> int:
    while True:
        said = await client.recv()
        for channel in json.loads(said).get("channels", ()) if isinstance(said, str) else ():
            if channel["topic"] == topic:
                return int(channel["id"])


async def _message(client: ClientConnection) -> bytes:
    while True:
        said = await client.recv()
        if isinstance(said, bytes):
            return said


async def test_a_latched_message_reaches_each_viewer_once_and_before_newer_ones() -> None:
    async with fleet() as robot:
        status = robot.node.advertise("/odom", "std_msgs/String", qos=LATCHED)
        status.publish({"data": "first"})
        async with viewers(robot, 3) as early:
            await until(lambda: all(each.data("/odom") == ["first"] for each in early))
            status.publish({"data": "second"})
            async with viewers(robot, 3) as late:
                await until(lambda: all(each.data("/odom") == ["second"] for each in late))
                status.publish({"data": "third"})
                await until(lambda: all(each.data("/odom") == ["second", "third"] for each in late))
                assert all(each.data("/odom") == ["first", "second", "third"] for each in early)


async def test_a_subscription_that_ends_gets_nothing_more_and_the_others_all() -> None:
    async with fleet() as robot:
        odometry = robot.node.advertise("/odom", "std_msgs/String")
        async with viewers(robot, 3) as (leaving, *staying):
            await leaving.say(op="unsubscribe", topic="/odom")
            await leaving.say(op="call_service", service="/rosapi/get_time", id="left")
            await until(lambda: leaving.others[-1].get("id") == "left")
            odometry.publish({"data": "x"})
            await until(lambda: all(each.data("/odom") == ["x"] for each in staying))
            assert not leaving.data("/odom")
            await leaving.say(op="subscribe", topic="/odom", type="std_msgs/String")
            await leaving.say(op="call_service", service="/rosapi/get_time", id="back")
            await until(lambda: leaving.others[-1].get("id") == "back")
            odometry.publish({"data": "y"})
            await until(lambda: all(each.data("/odom") == ["x", "y"] for each in staying))
            await until(lambda: leaving.data("/odom") == ["y"])


async def test_a_viewer_that_reads_nothing_loses_samples_alone_and_hears_of_it() -> None:
    limits = Limits(data_bytes=500_000)
    async with fleet(limits) as robot:
        images = robot.node.advertise("/odom", "std_msgs/String")
        async with viewers(robot, 2) as (healthy, _), connect(path(robot), max_queue=1) as stalled:
            stalled.transport.pause_reading()
            wish = {"op": "subscribe", "topic": "/odom", "type": "std_msgs/String"}
            await stalled.send(json.dumps({"op": "set_level", "level": "warning"}))
            await stalled.send(json.dumps(wish))
            count = 150
            for number in range(count):
                images.publish({"data": f"{number} ".ljust(100_000)})
                await heard([healthy], number + 1)
            stalled.transport.resume_reading()
            said: list[Any] = []
            with anyio.fail_after(60):
                while not any(op["op"] == "status" for op in said):
                    said.append(msgspec.json.decode(await stalled.recv()))
            numbers = [int(op["msg"]["data"]) for op in said if op["op"] == "publish"]
            assert numbers == sorted(set(numbers)) and len(numbers) < count
            notice = next(op for op in said if op["op"] == "status")
            assert "this connection is slower than what it is subscribed to" in notice["msg"]


async def test_metrics_say_what_crosses_for_whom() -> None:
    async with fleet() as robot, viewers(robot, 3) as found:
        robot.node.advertise("/odom", "std_msgs/String").publish({"data": "1"})
        await heard(found, 1)
        url = f"{robot.server.urls[0].replace('ws://', 'http://')}/metrics"
        with await to_thread.run_sync(partial(urlopen, url, timeout=60)) as page:
            lines = page.read().decode().splitlines()
        hub = f"{robot.hub.url}/robots/rosie"
        assert f'rwt_dial_topic_clients{{hub="{hub}",topic="/odom"}} 3' in lines
