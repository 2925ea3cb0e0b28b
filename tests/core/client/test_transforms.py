"""Transform lookups: waiting, failing in words, both ways of listening, both faces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import anyio
import pytest

from rwt import Server
from rwt.extensions.tf_stream import Tf2WebRepublisher
from rwt_client import ConnectionLost
from rwt_client.blocking import connect as connect_blocking
from rwt_graph import Node
from rwt_participant.errors import CallFailed, TransformUnavailable
from rwt_tf2 import StampedTransform, Transform, write_transform
from tests.core.client.worlds import AT_ONCE, World, scripted, world
from tests.waiting import until

pytestmark = pytest.mark.anyio

S = 1_000_000_000


def message(parent: str, child: str, seconds: float, x: float, yaw: float = 0.0) -> dict[str, Any]:
    moved = Transform.from_rpy((x, 0.0, 0.0), 0.0, 0.0, yaw)
    return {"transforms": [write_transform(StampedTransform(parent, child, round(seconds * S), moved))]}


class Frames:
    """A robot that publishes its frames."""

    def __init__(self, node: Node) -> None:
        self.moving = node.advertise("/tf", "tf2_msgs/TFMessage")
        self.fixed = node.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True)
        self.fixed.publish(message("base", "laser", 0, 0.5))

    def move(self, seconds: float, x: float, yaw: float = 0.0) -> None:
        self.moving.publish(message("map", "base", seconds, x, yaw))


async def test_a_lookup_waits_until_the_transform_is_known(transport: str) -> None:
    async with world(transport) as it, anyio.create_task_group() as tasks:
        frames = Frames(it.node)
        found: list[StampedTransform] = []

        async def ask() -> None:
            found.append(await it.robot.tf.lookup("map", "laser", timeout=10))

        tasks.start_soon(ask)
        await it.subscribed("/tf")
        frames.move(12.5, 2.0, math.pi / 2)
        await until(lambda: found)
        assert (found[0].parent, found[0].child, found[0].stamp_ns) == ("map", "laser", 12_500_000_000)
        assert found[0].transform.apply((1.0, 0.0, 0.0)) == pytest.approx((2.0, 1.5, 0.0))


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_a_time_may_be_a_messages_stamp(distro: str) -> None:
    async with world(distro=distro) as it:
        frames = Frames(it.node)
        await it.robot.tf.start()
        await it.subscribed("/tf")
        frames.move(1.0, 1.0)
        frames.move(2.0, 2.0)
        header: Any = it.robot.types["std_msgs/Header"]()
        stamp = header.stamp
        setattr(stamp, "sec" if distro == "jazzy" else "secs", 1)
        setattr(stamp, "nanosec" if distro == "jazzy" else "nsecs", S // 4)
        for time in (stamp, S + S // 4):
            found = await it.robot.tf.lookup("map", "base", time, timeout=10)
            assert found.transform.translation == pytest.approx((1.25, 0.0, 0.0))
        full = await it.robot.tf.lookup_full("base", 2 * S, "base", stamp, "map", timeout=10)
        assert full.transform.translation == pytest.approx((-0.75, 0.0, 0.0))
        assert await it.robot.tf.can_transform("map", "base", S)
        assert "into the future" in (await it.robot.tf.can_transform("map", "base", 3 * S)).reason


async def started(it: World) -> Frames:
    frames = Frames(it.node)
    await it.robot.tf.start()
    await it.subscribed("/tf")
    frames.move(1.0, 1.0)
    await until(lambda: it.robot.tf.buffer.has_frame("map"))
    return frames


async def test_what_does_not_come_is_told_in_words() -> None:
    async with world() as it:
        with pytest.raises(
            TransformUnavailable, match=r"no transform came on /tf or /tf_static within 0.05 s"
        ):
            await it.robot.tf.lookup("map", "base", timeout=0.05)
        await started(it)
        with pytest.raises(
            TransformUnavailable, match=r'not available within 0.05 s: frame "ghost" is not known; known are'
        ) as failure:
            await it.robot.tf.lookup("map", "ghost", timeout=0.05)
        assert isinstance(failure.value, LookupError)
        with pytest.raises(TransformUnavailable, match=r"needs map <- base extrapolated into the future"):
            await it.robot.tf.lookup("map", "base", 5 * S, timeout=0.05)


async def test_a_time_that_is_over_is_not_waited_for() -> None:
    async with world() as it:
        await started(it)
        with anyio.fail_after(5), pytest.raises(TransformUnavailable, match="into the past"):
            await it.robot.tf.lookup("map", "base", S // 2, timeout=None)


async def test_closing_unsubscribes_and_forgets() -> None:
    async with world() as it:
        await started(it)
        it.robot.tf.close()
        await it.arrives(lambda: not (info := it.graph.topic("/tf")) or not info.subscribers)
        assert it.robot.tf.buffer.frames() == ()
        await started(it)


async def test_the_end_of_the_connection_ends_the_wait() -> None:
    async with scripted(reconnect=None) as (server, robot), anyio.create_task_group() as tasks:
        failures: list[ConnectionLost] = []

        async def ask() -> None:
            with pytest.raises(ConnectionLost) as failure:
                await robot.tf.lookup("map", "base", timeout=None)
            failures.append(failure.value)

        tasks.start_soon(ask)
        await server.hears("subscribe", 2)
        server.hang_up()
        await until(lambda: failures)


async def test_a_lost_connection_is_a_gap() -> None:
    async with scripted(reconnect=AT_ONCE) as (server, robot):
        await robot.tf.start()
        await server.hears("subscribe", 2)
        server.publish("/tf", message("map", "base", 1.0, 1.0))
        assert (await robot.tf.lookup("map", "base", timeout=10)).stamp_ns == S
        server.hang_up()
        await server.hears("subscribe", 4)
        server.publish("/tf", message("map", "base", 2.0, 2.0))
        assert (await robot.tf.lookup("map", "base", 2 * S, timeout=10)).stamp_ns == 2 * S


# -- only what changes


async def test_the_compact_way_hears_the_tree_from_the_republisher(transport: str) -> None:
    async with world(transport) as it:
        with Tf2WebRepublisher(it.graph):
            frames = Frames(it.node)
            await it.robot.tf.start_compact(rate=100)
            await it.subscribed("/tf")
            frames.move(1.0, 2.0)
            found = await it.robot.tf.lookup("map", "laser", timeout=10)
            assert found.transform.translation == pytest.approx((2.5, 0.0, 0.0))
            frames.move(2.0, 3.0)
            buffer = it.robot.tf.buffer
            await until(lambda: buffer.lookup_transform("map", "base").transform.translation[0] == 3.0)


async def test_the_compact_way_needs_a_republisher() -> None:
    async with world() as it:
        with pytest.raises(CallFailed, match="republish_tfs"):
            await it.robot.tf.start_compact()
        await started(it)
        assert await it.robot.tf.can_transform("map", "laser")


async def test_the_compact_way_asks_again_on_a_new_connection() -> None:
    async with scripted(reconnect=AT_ONCE) as (server, robot):
        server.answers["/republish_tfs"] = {"topic_name": "/first"}
        await robot.tf.start_compact(rate=5, linear=0.1, angular=0.2)
        assert (await server.hears("call_service"))["args"] == {
            "source_frames": [],
            "target_frame": "",
            "angular_thres": pytest.approx(0.2),
            "trans_thres": pytest.approx(0.1),
            "rate": 5.0,
            "timeout": {"sec": 0, "nanosec": 0},
        }
        subscribed = await server.hears("subscribe")
        assert (subscribed["topic"], subscribed["compression"]) == ("/first", "cbor")
        server.answers["/republish_tfs"] = {"topic_name": "/second"}
        server.hang_up()
        await server.hears("call_service", 2)
        await until(lambda: server.ops("subscribe")[-1]["topic"] == "/second")
        server.answers["/republish_tfs"] = "it has gone"
        server.hang_up()
        await server.hears("call_service", 3)


# -- from threads


@contextmanager
def server() -> Iterator[str]:
    """A robot that stands at 1, and its server, on an event loop in another thread."""
    with Server("ws://127.0.0.1:0") as robot:
        frames = Frames(robot.node)
        robot.node.create_timer(0.02, lambda: frames.move(1.0, 1.0))
        yield robot.server.urls[0]


def test_the_blocking_face() -> None:
    with server() as url, connect_blocking(url) as robot:
        found = robot.tf.lookup("map", "laser", timeout=10)
        assert found.transform.translation == pytest.approx((1.5, 0.0, 0.0))
        assert robot.tf.can_transform("laser", "map")
        assert robot.tf.tree().startswith("map\n└─ base")
        with pytest.raises(TransformUnavailable):
            robot.tf.lookup("map", "ghost", timeout=0.01)
        robot.tf.close()
        robot.tf.start_compact()
        assert robot.tf.lookup("base", "laser", timeout=10).transform.translation[0] == 0.5
