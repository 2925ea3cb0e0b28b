"""Topics: iterators, callbacks, queues, publishers."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import Any

import anyio
import anyio.lowlevel
import numpy as np
import pytest

from rwt import Server
from rwt_client import MessageRejected, ServerRefused, connect
from rwt_participant.errors import CallTimeout, NotFound, RobotError
from rwt_participant.qos import QoS
from tests.core.client.worlds import scripted, world
from tests.waiting import until

pytestmark = pytest.mark.anyio


async def test_a_topic_that_nobody_knows_needs_a_type() -> None:
    async with world() as it:
        with pytest.raises(NotFound, match="the robot knows no topic /nothing; name its type"):
            await it.robot.once("/nothing")


async def test_a_plain_callback_is_called_at_once_and_may_fail(caplog: pytest.LogCaptureFixture) -> None:
    async with scripted() as (server, robot):
        heard: list[int] = []

        def callback(message: Any) -> None:
            heard.append(message.data)
            if message.data == 1:
                raise ValueError("a mistake in the callback")

        await robot.subscribe("/count", callback, "std_msgs/Int32")
        await server.hears("subscribe")
        for number in range(3):
            server.publish("/count", {"data": number})
        await until(lambda: len(heard) >= 3)
        assert heard == [0, 1, 2]
        assert "a subscriber of /count failed" in caplog.text


async def test_an_asynchronous_callback_gets_one_message_after_the_other() -> None:
    async with scripted() as (server, robot):
        running = 0
        heard: list[int] = []
        done = anyio.Event()

        async def callback(message: Any) -> None:
            nonlocal running
            running += 1
            assert running == 1
            await anyio.lowlevel.checkpoint()
            heard.append(message.data)
            running -= 1
            if message.data == 4:
                done.set()

        await robot.subscribe("/count", callback, "std_msgs/Int32")
        await server.hears("subscribe")
        for number in range(5):
            server.publish("/count", {"data": number})
        await done.wait()
        assert heard == [0, 1, 2, 3, 4]


async def test_of_too_many_messages_the_newest_stay_and_drops_are_counted() -> None:
    async with scripted() as (server, robot), robot.topic("/count", "std_msgs/Int32", queue_size=3) as counts:
        await server.hears("subscribe")
        for number in range(10):
            server.publish("/count", {"data": number})
        await until(lambda: counts.received >= 10)
        assert [(await counts.get()).data for _ in range(3)] == [7, 8, 9]
        assert counts.dropped == 7


async def test_the_queue_is_bounded_in_bytes_too_and_keeps_one_message_of_any_size() -> None:
    async with (
        scripted() as (server, robot),
        robot.topic("/text", "std_msgs/String", queue_bytes=100) as texts,
    ):
        await server.hears("subscribe")
        for letter in "abc":
            server.publish("/text", {"data": letter * 500})
        await until(lambda: texts.received >= 3)
        assert (await texts.get()).data == "c" * 500
        assert texts.dropped == 2


async def test_a_message_that_does_not_fit_is_left_out_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    async with scripted() as (server, robot):
        async with robot.topic("/count", "std_msgs/Int32") as counts:
            await server.hears("subscribe")
            server.publish("/count", {"data": "many"})
            server.publish("/count", {"data": 5})
            assert (await counts.get(timeout=5)).data == 5
            assert counts.invalid == 1
        assert 'not std_msgs/Int32: data: expected int32, got "many"' in caplog.text


async def test_closing_ends_the_iteration_and_unsubscribes() -> None:
    async with scripted() as (server, robot):
        counts = robot.topic("/count", "std_msgs/Int32")
        await counts
        subscribed = await server.hears("subscribe")
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(_expect_no_message, counts)
            await anyio.lowlevel.checkpoint()
            counts.close()
        left = await server.hears("unsubscribe")
        assert (left["topic"], left["id"]) == ("/count", subscribed["id"])


async def _expect_no_message(messages: Any) -> None:
    assert [message async for message in messages] == []


async def test_options_reach_the_server() -> None:
    async with scripted() as (server, robot):
        options: dict[str, Any] = {"throttle": 0.25, "fragment_size": 5000, "compression": "png"}
        await robot.topic("/odom", "nav_msgs/Odometry", qos=QoS(depth=3, deadline=0.5), **options)
        op = await server.hears("subscribe")
    assert (op["type"], op["throttle_rate"], op["fragment_size"]) == ("nav_msgs/msg/Odometry", 250, 5000)
    policies = {"history": "keep_last", "reliability": "reliable", "durability": "volatile"}
    assert (op["compression"], op["qos"]) == ("png", {**policies, "depth": 3, "deadline": 0.5})


async def test_a_refused_subscription_says_why_in_the_servers_words() -> None:
    async with scripted() as (server, robot):
        messages = robot.topic("/secret", "std_msgs/String")
        await messages
        op = await server.hears("subscribe")
        server.say({"op": "status", "level": "error", "msg": "not for you", "id": op["id"]})
        with pytest.raises(ServerRefused, match=r"^not for you$"):
            await messages.get(timeout=5)


async def test_numbers_come_as_numpy_arrays_where_that_is_asked_for() -> None:
    async with scripted(arrays="numpy") as (server, robot):
        async with robot.topic("/scan", "sensor_msgs/LaserScan", compression="none") as scans:
            await server.hears("subscribe")
            server.publish("/scan", {"ranges": [1.0, 2.5, None], "intensities": []})
            scan = await scans.get(timeout=5)
        assert scan.ranges.dtype == np.float32
        np.testing.assert_array_equal(scan.ranges, np.array([1.0, 2.5, np.nan], np.float32))
        assert scan.intensities.shape == (0,)


async def test_arrays_in_nested_messages_become_numpy_arrays_too() -> None:
    async with scripted() as (server, robot):
        async with robot.topic("/array", "std_msgs/Float64MultiArray", arrays="numpy") as arrays:
            await server.hears("subscribe")
            server.publish("/array", {"data": [1, 2], "layout": {"dim": [{"label": "x", "size": 2}]}})
            message = await arrays.get(timeout=5)
        assert message.data.tolist() == [1.0, 2.0]
        assert message.layout.dim[0].label == "x"


# -- publishing ----------------------------------------------------------------------------------------------


@dataclass
class Vector:
    x: float = 0.0
    y: float = 0.0


@dataclass
class Speed:
    """A dataclass with some of the fields of a Twist."""

    linear: Vector = field(default_factory=Vector)


async def test_what_can_be_published(transport: str) -> None:
    async with world(transport) as it:
        heard: list[Any] = []
        it.node.subscribe("/cmd_vel", heard.append, type="geometry_msgs/Twist")
        twist: Any = it.robot.types["geometry_msgs/Twist"]()
        twist.linear.x = 1.0
        await it.robot.publish("/cmd_vel", twist)
        await it.robot.publish("/cmd_vel", {"linear": {"x": 2.0}})
        await it.robot.publish("/cmd_vel", Speed(Vector(3.0)))
        await it.arrives(lambda: len(heard) == 3)
        assert [message.linear.x for message in heard] == [1.0, 2.0, 3.0]


async def test_numpy_arrays_can_be_published() -> None:
    async with world() as it:
        heard: list[Any] = []
        it.node.subscribe("/scan", heard.append, type="sensor_msgs/LaserScan")
        with await it.robot.advertise("/scan", "sensor_msgs/LaserScan") as scans:
            scans.publish({"ranges": np.linspace(0, 1, 3)})
            await it.arrives(lambda: heard)
        assert heard[0].ranges == [0.0, 0.5, 1.0]


async def test_advertising_says_what_was_asked_for() -> None:
    async with scripted() as (server, robot):
        await robot.advertise("/map", "nav_msgs/OccupancyGrid", latch=True, queue_size=1)
        op = await server.hears("advertise")
        assert (op["type"], op["latch"], op["queue_size"]) == ("nav_msgs/msg/OccupancyGrid", True, 1)


async def test_a_refused_advertisement_is_told_with_the_next_message() -> None:
    async with scripted() as (server, robot):
        publisher = await robot.advertise("/odom", "std_msgs/String")
        op = await server.hears("advertise")
        server.say({"op": "status", "level": "error", "msg": "/odom has another type", "id": op["id"]})
        with pytest.raises(ServerRefused, match="/odom has another type"):
            while True:
                publisher.publish({"data": "x"})
                await anyio.sleep(0.001)


async def test_nothing_can_be_published_after_the_end() -> None:
    async with scripted() as (_, robot):
        publisher = await robot.advertise("/chatter", "std_msgs/String")
        publisher.close()
        publisher.close()
        with pytest.raises(RobotError, match="the publisher on /chatter was closed"):
            publisher.publish({"data": "x"})


async def test_every_message_published_before_the_end_of_the_block_arrives() -> None:
    async with world("ws") as it:
        heard: list[Any] = []
        it.node.subscribe("/chatter", lambda message: heard.append(len(message.data)), type="std_msgs/String")
        with await it.robot.advertise("/chatter", "std_msgs/String") as talker:
            for _ in range(40):
                talker.publish({"data": "x" * 20_000})
            await talker.drain()
        await it.arrives(lambda: len(heard) == 40)
        assert talker.dropped == 0


async def test_a_rejected_message_is_logged_counted_and_raised_by_confirm(
    caplog: pytest.LogCaptureFixture,
) -> None:
    rule = {"topics": ["/cmd_vel"], "fields": {"linear.x": {"max": 0.5}}}
    async with (
        Server("ws://127.0.0.1:0", gate={"rules": {"slow": rule}}) as server,
        connect(server.urls[0]) as robot,
    ):
        events: list[str] = []
        robot.on_event(lambda event: events.append(event.text))
        wheels = robot.publish("/cmd_vel", {"linear": {"x": 0.5}}, "geometry_msgs/Twist")
        other = robot.publish("/chatter", {"data": "x"}, "std_msgs/String")
        await wheels.confirm()
        for x in (1.0, 2.0, 0.1):
            robot.publish("/cmd_vel", {"linear": {"x": x}})
        with pytest.raises(MessageRejected, match=r"linear\.x: expected at most 0\.5, got 1 .*slow"):
            await wheels.confirm()
        await wheels.confirm()  # It was raised once.
        await other.confirm()  # Messages of other publishers do not matter.
        assert (wheels.rejected, other.rejected) == (2, 0)
        assert any("got 2" in text for text in events)
    assert "the server rejected a message for /cmd_vel: publish: linear.x: expected" in caplog.text


async def test_equal_rejections_are_logged_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    async with scripted() as (server, robot):
        publisher = robot.publish("/chatter", {"data": "x"}, "std_msgs/String")
        sent = await server.hears("publish")
        for text in ("too fast", "too fast", "too fast", "not allowed"):
            server.say({"op": "status", "level": "error", "msg": text, "id": sent["id"]})
        await until(lambda: publisher.rejected == 4)
    lines = [record.getMessage() for record in caplog.records if "rejected a message" in record.message]
    assert len(lines) < 4 and lines[-1].endswith("/chatter: not allowed (4 so far)")


async def test_confirm_raises_what_rejects_every_message() -> None:
    roles = {"guest": {"publish": ["/chat"], "call": []}}
    async with (
        Server("ws://127.0.0.1:0", auth={"default_role": "guest"}, roles=roles) as server,
        connect(server.urls[0]) as robot,
    ):
        await robot.publish("/chat", {"data": "x"}, "std_msgs/String").confirm()
        with pytest.raises(ServerRefused, match="role 'guest' may not publish on /cmd_vel"):
            await robot.publish("/cmd_vel", {}, "geometry_msgs/Twist").confirm()


async def test_confirm_ends_without_an_answer() -> None:
    async with scripted() as (_, robot):
        with pytest.raises(CallTimeout, match="get_time gave no answer"):
            await robot.publish("/chatter", {"data": "x"}, "std_msgs/String").confirm(timeout=0.1)


async def test_a_complaint_that_nobody_waits_for_is_an_event(caplog: pytest.LogCaptureFixture) -> None:
    async with scripted() as (server, robot):
        events = robot.events()
        await server.hears("set_level")
        server.say({"op": "status", "level": "warning", "msg": "you publish too fast"})
        event = await anext(events)
        assert (event.kind, event.level, event.text) == ("status", "warning", "you publish too fast")
        assert "the server says (warning): you publish too fast" in caplog.text


async def test_what_is_not_understood_is_logged_and_costs_nothing(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    async with scripted() as (server, robot):
        async with robot.topic("/count", "std_msgs/Int32") as counts:
            await server.hears("subscribe")
            for garbage in (b"nonsense", b'{"op":"dance"}', b"[]", b"", b"\xff\xfe", b'{"op":"publish"}'):
                server.say_raw(garbage)
            server.say_raw(b"\xa1\x00\x00", binary=True)
            server.publish("/count", {"data": 1})
            assert (await counts.get(timeout=5)).data == 1
        assert 'unknown operation "dance"' in caplog.text
