"""The blocking face: the same robot from threads without an event loop."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any, cast

import pytest

from rwt_client import BadAddress, CannotConnect, ConnectionClosed
from rwt_client.blocking import BlockingRobot, connect
from rwt_participant.errors import TimedOut
from rwt_participant.goals import GoalStatus, ReceivedGoal

FIBONACCI = "example_interfaces/Fibonacci"


@pytest.fixture(scope="module")
def robot(url: str) -> Iterator[BlockingRobot]:
    with connect(url) as connected:
        yield connected


def test_topics_are_iterators(robot: BlockingRobot) -> None:
    with robot.topic("/odom") as odometry:
        stamps = [message.header.stamp for message, _ in zip(odometry, range(3), strict=False)]
    assert [type(stamp).__name__ for stamp in stamps] == ["Time"] * 3
    assert odometry.received >= 3
    assert odometry.dropped == 0
    assert list(odometry) == []


def test_one_message(robot: BlockingRobot) -> None:
    assert robot.once("/map", timeout=60).info.width > 0
    with pytest.raises(TimedOut, match=r"no message came on /nothing within 0.05 s"):
        robot.once("/nothing", "std_msgs/String", timeout=0.05)


def test_publishing_and_callbacks(robot: BlockingRobot) -> None:
    heard: list[Any] = []
    came = threading.Event()

    def callback(message: Any) -> None:
        heard.append((message.data, threading.current_thread() is threading.main_thread()))
        came.set()

    subscription = robot.subscribe("/talk", callback, "std_msgs/String")
    robot.publish("/talk", {"data": "one"}, "std_msgs/String")
    assert came.wait(10)
    came.clear()
    with robot.advertise("/talk", "std_msgs/String") as talker:
        talker.publish({"data": "two"})
        talker.drain()
        assert came.wait(10)
    subscription.close()
    assert heard == [("one", False), ("two", False)]


def test_services(robot: BlockingRobot) -> None:
    assert robot.call("/add_two_ints", {"a": 1, "b": 2}).sum == 3
    with robot.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"message": "beep"}) as offer:
        assert offer.name == "/beep"
        assert robot.call("/beep").message == "beep"


def test_actions(robot: BlockingRobot) -> None:
    goal = robot.send_goal("/fibonacci", {"order": 3})
    assert [feedback.sequence for feedback in goal][-1] == [0, 1, 1, 2]
    assert goal.result().status is goal.status is GoalStatus.SUCCEEDED
    assert goal.done

    async def wait(goal: ReceivedGoal) -> None:
        await goal.cancel_event.wait()

    with robot.advertise_action("/wait", FIBONACCI, wait):
        waiting = robot.send_goal("/wait")
        waiting.cancel()
        assert waiting.result(timeout=10).status is GoalStatus.SUCCEEDED


def test_questions_and_parameters(robot: BlockingRobot) -> None:
    assert "/demo_robot" in robot.api.nodes()
    assert robot.api.topic_type("/odom") == "nav_msgs/msg/Odometry"
    robot.params.set("/demo_robot:max_speed", 0.5)
    assert robot.params.get("/demo_robot:max_speed") == 0.5
    assert robot.time_ns() > 0
    assert robot.run(robot.types.fetch, "nav_msgs/Odometry") is robot.types["nav_msgs/Odometry"]


def test_events_and_the_end(url: str) -> None:
    robot = connect(url)
    kinds: list[str] = []
    robot.on_event(lambda event: kinds.append(event.kind))
    ended: list[str] = []
    robot.on_event(lambda event: ended.append(event.kind))()
    assert robot.connected
    robot.close()
    robot.close()
    assert (kinds, ended) == (["closed"], [])
    assert not robot.connected


def test_errors_come_out_as_themselves() -> None:
    with pytest.raises(CannotConnect, match="the connection was refused"):
        connect("ws://127.0.0.1:1")
    with pytest.raises(BadAddress, match="use one of ws:"):
        connect("robot:9090")


def test_a_closed_robot_says_that_it_was_closed(url: str) -> None:
    robot = connect(url)
    robot.close()
    robot.close()
    with pytest.raises(ConnectionClosed, match="was closed by this program"):
        robot.call("/add_two_ints")


def test_words_that_choose_nothing_are_refused(robot: BlockingRobot, url: str) -> None:
    with pytest.raises(ValueError, match="arrays: expected list or numpy, got 'nump'"):
        connect(url, arrays=cast(Any, "nump"))
    with pytest.raises(ValueError, match="arrays: expected list or numpy, got 'nump'"):
        robot.once("/scan", arrays=cast(Any, "nump"))
    with pytest.raises(ValueError, match="compression: expected one of auto, none, png, cbor, got 'zip'"):
        robot.topic("/odom", compression=cast(Any, "zip"))


def test_arguments_in_the_wrong_order_are_named(robot: BlockingRobot) -> None:
    for words in [("/odom", "nav_msgs/Odometry"), ("/odom", print, print)]:
        with pytest.raises(TypeError, match=r"subscribe.*expected (a function|the name of a type)"):
            robot.subscribe(*cast("Any", words))
