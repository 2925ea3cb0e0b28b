"""`with Server() as robot:` in programs without an event loop."""

from __future__ import annotations

import asyncio
import re
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import pytest

from rwt import BlockingNode, Server, Settings, SettingsError
from rwt.server import Loop
from rwt_client.blocking import connect
from rwt_client.endpoints import subscriptions
from rwt_graph import NotRunning
from rwt_graph.nodes import endpoints
from rwt_participant import messages, timers
from rwt_participant.errors import InvalidMessage, NotFound, ServiceFailed, TimedOut, WrongThread
from rwt_participant.threads.outbox import OUTBOX_MESSAGES
from tests.waiting import wait_until

URL = "ws://127.0.0.1:0"


def add(request: Any) -> dict[str, object]:
    return {"sum": request.a + request.b}


async def count(goal: Any) -> dict[str, object]:
    goal.publish_feedback({"sequence": [0]})
    return {"sequence": list(range(goal.request.order))}


def test_a_script_is_a_robot(loop: Loop) -> None:
    with Server(URL, loop=loop) as robot:
        robot.advertise_service("/add", "example_interfaces/AddTwoInts", add)
        robot.advertise_action("/count", "example_interfaces/Fibonacci", count)
        robot.publish("/battery", {"data": 12.5}, "std_msgs/Float32", latch=True)
        robot.publish("/battery", {"data": 12.25})
        with connect(robot.server.urls[0]) as client:
            assert client.once("/battery").data == 12.25
            assert client.call("/add", {"a": 20, "b": 22}).sum == 42
        feedback: list[Any] = []
        goal = robot.send_goal("/count", {"order": 3}, on_feedback=feedback.append)
        status, result = goal.result()
        assert (status.name, list(result.sequence)) == ("SUCCEEDED", [0, 1, 2])
        assert [list(each.sequence) for each in feedback] == [[0]]


def test_a_blocking_node_has_everything_that_a_node_has() -> None:
    with Server(URL) as robot:
        has = {name for name in dir(robot.node) if not name.startswith("_")}
        assert has - set(dir(robot)) == {"graph", "run", "run_blocking"}, "for the loop's own thread"
        robot.log.info("ready")
        robot.parameters.declare("speed", 1.0)
        assert robot.params.get(f"{robot.name}:speed") == 1.0
        began = robot.clock.monotonic()
        robot.clock.sleep(0.02)
        assert robot.clock.monotonic() >= began + 0.02


def test_a_callback_that_holds_the_loop_is_named(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for module in (messages, timers, endpoints, subscriptions):
        monkeypatch.setattr(module, "HELD_SECONDS", 0.05)

    def slow(*_: object) -> None:
        time.sleep(0.06)

    with Server(URL) as robot, connect(robot.server.urls[0]) as client:
        robot.subscribe("/a", slow, "std_msgs/Empty")
        client.subscribe("/a", slow, "std_msgs/Empty")
        robot.advertise_service("/s", "std_srvs/Empty", slow)
        timer = robot.create_timer(0.01, slow)
        client.call("/s")
        client.publish("/a", {}, "std_msgs/Empty")
        wait_until(lambda: caplog.text.count("callback of /a: ") >= 2)
        wait_until(lambda: "timer callback " in caplog.text)
        timer.cancel()
        assert re.search(r"service handler .*\.slow took 0\.\d s and held the event loop", caplog.text)


def test_a_script_is_also_a_client_of_its_own_graph(loop: Loop) -> None:
    with Server(URL, demo=True, loop=loop) as robot:
        assert robot.call("/add_two_ints", {"a": 1, "b": 2}).sum == 3
        robot.params.set("/demo_robot:camera_rate", 2.5)
        assert robot.params.get("/demo_robot:camera_rate") == 2.5
        with robot.topic("/odom") as places:
            assert [next(places).child_frame_id for _ in range(2)] == ["base_link"] * 2


def test_what_goes_wrong_is_raised_where_it_was_asked_for() -> None:
    def fail(request: Any) -> None:
        raise ServiceFailed("no power")

    with Server(URL) as robot:
        robot.advertise_service("/fail", "std_srvs/Trigger", fail)
        with pytest.raises(ServiceFailed, match="no power"):
            robot.call("/fail")
        with pytest.raises(TimedOut, match=r"no message came on /silence within 0\.01 s"):
            robot.once("/silence", "std_msgs/String", timeout=0.01)
        with pytest.raises(NotFound, match="no topic /nothing that has a type"):
            robot.publish("/nothing", {"data": "x"})
        messages = robot.topic("/silence", "std_msgs/String")
        messages.close()
        assert list(messages) == []
    with pytest.raises(NotRunning):
        robot.call("/fail")


def test_publishing_from_a_thread_does_not_wait_for_a_held_loop(caplog: pytest.LogCaptureFixture) -> None:
    """Each of these would wait for ever: the loop is released only after them."""
    held, released = threading.Event(), threading.Event()
    heard: list[float] = []

    def hold(request: object) -> None:
        held.set()
        released.wait()

    with Server(URL) as robot:
        robot.advertise_service("/hold", "std_srvs/Empty", hold)
        robot.subscribe("/speed", lambda message: heard.append(message.data), "std_msgs/Float64")
        speeds = robot.advertise("/speed", "std_msgs/Float64")
        robot.publish("/other", {"data": 0.0}, "std_msgs/Float64")
        call = threading.Thread(target=robot.call, args=("/hold",))
        call.start()
        held.wait()
        for number in range(OUTBOX_MESSAGES + 500):
            speeds.publish({"data": number})
        robot.publish("/other", {"data": 1.0})
        robot.log.warning("the loop is held")
        released.set()
        call.join()
        robot.clock.sleep(0.0)
        assert heard == list(range(500, OUTBOX_MESSAGES + 500))
        assert (speeds.dropped, speeds.subscriber_count) == (500, 1)
    assert caplog.text.count("messages of /speed are dropped") == 1


def test_publishing_by_a_blocking_client_does_not_wait_for_a_held_loop() -> None:
    held, released = threading.Event(), threading.Event()
    heard: list[float] = []

    async def hold() -> None:
        held.set()
        released.wait()

    with Server(URL) as robot, connect(robot.server.urls[0]) as client:
        robot.subscribe("/speed", lambda message: heard.append(message.data), "std_msgs/Float64")
        speeds = client.advertise("/speed", "std_msgs/Float64")
        client.publish("/other", {"data": 0.0}, "std_msgs/Float64")
        waiting = threading.Thread(target=client.run, args=(hold,))
        waiting.start()
        held.wait()
        for number in range(OUTBOX_MESSAGES + 500):
            speeds.publish({"data": number})
        client.publish("/other", {"data": 1.0})
        with pytest.raises(InvalidMessage, match="expected float64"):
            speeds.publish({"data": "fast"})
        released.set()
        waiting.join()
        speeds.drain()
        speeds.confirm()
        assert speeds.dropped + len(heard) == OUTBOX_MESSAGES + 500
        assert speeds.dropped >= 500
        assert heard[-1] == OUTBOX_MESSAGES + 499


WAITS: dict[str, Callable[[BlockingNode], object]] = {
    "call": lambda robot: robot.call("/ask"),
    "once": lambda robot: robot.once("/x", "std_msgs/String"),
    "send_goal": lambda robot: robot.send_goal("/count"),
    "get_param": lambda robot: robot.params.get("/robot:use_sim_time"),
    "set_param": lambda robot: robot.params.set("/robot:use_sim_time", True),
    "spin": lambda robot: robot.spin(),
}


@pytest.mark.parametrize("name", WAITS)
def test_what_waits_cannot_hang_the_loop_that_it_waits_for(name: str, loop: Loop) -> None:
    raised: Future[BaseException | None] = Future()
    with Server(URL, loop=loop) as robot:

        def answer(request: Any) -> None:
            try:
                WAITS[name](robot)
            except WrongThread as error:
                raised.set_result(error)

        robot.advertise_service("/ask", "std_srvs/Trigger", answer)
        robot.call("/ask", timeout=10.0)
    assert raised.result(timeout=0) is not None


def test_a_notebook_has_a_loop_of_its_own_running() -> None:
    async def cell() -> object:
        with Server(URL) as robot:
            robot.advertise_service("/add", "example_interfaces/AddTwoInts", add)
            return robot.call("/add", {"a": 1, "b": 1}).sum

    assert asyncio.run(cell()) == 2


def test_settings_are_checked_before_anything_starts() -> None:
    with pytest.raises(SettingsError, match="processes cannot share"):
        Server(URL, settings=Settings(workers=2)).__enter__()
