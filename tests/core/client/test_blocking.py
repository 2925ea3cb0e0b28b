"""The blocking face: the same robot from threads without an event loop."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any, cast

import pytest

from rwt_client import BadAddress, CannotConnect, ConnectionClosed
from rwt_client.blocking import BlockingRobot, connect


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


def test_questions_and_types(robot: BlockingRobot) -> None:
    assert "/demo_robot" in robot.api.nodes()
    assert robot.run(robot.types.fetch, "nav_msgs/Odometry") is robot.types["nav_msgs/Odometry"]


def test_events_and_the_end(url: str) -> None:
    robot = connect(url)
    kinds: list[str] = []
    robot.on_event(lambda event: kinds.append(event.kind))
    ended: list[str] = []
    robot.on_event(lambda event: ended.append(event.kind))()
    connected = [robot.connected]
    robot.close()
    robot.close()
    connected.append(robot.connected)
    assert (kinds, ended, connected) == (["closed"], [], [True, False])
    with pytest.raises(ConnectionClosed, match="was closed by this program"):
        robot.call("/add_two_ints")


def test_errors_come_out_as_themselves() -> None:
    with pytest.raises(CannotConnect, match="the connection was refused"):
        connect("ws://127.0.0.1:1")
    with pytest.raises(BadAddress, match="use one of ws:"):
        connect("robot:9090")


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
