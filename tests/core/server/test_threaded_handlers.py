"""Plain handlers that block, in threads of a bounded pool: of a server's node, and of a client."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any, TypeAlias

import pytest

from rwt import BlockingNode, GoalAborted, GoalCanceled, Server, ServiceFailed
from rwt.server import Loop
from rwt_client.blocking import BlockingRobot, connect
from rwt_participant.threads.pool import HandlerThreads
from tests.waiting import wait_until

Robot: TypeAlias = "BlockingNode | BlockingRobot"


@pytest.fixture(params=["node", "client"])
def sides(request: pytest.FixtureRequest, loop: Loop) -> Iterator[tuple[Robot, BlockingRobot, BlockingNode]]:
    """Return who offers, a client that uses it, and the server's node."""
    with ExitStack() as stack:
        node = stack.enter_context(Server("ws://127.0.0.1:0", loop=loop))
        user = stack.enter_context(connect(node.server.urls[0]))
        offering = node if request.param == "node" else stack.enter_context(connect(node.server.urls[0]))
        yield offering, user, node


Sides: TypeAlias = "tuple[Robot, BlockingRobot, BlockingNode]"


def test_a_service_that_blocks_does_not_hold_the_loop(sides: Sides) -> None:
    robot, user, node = sides
    released = threading.Event()

    def hold(request: Any) -> dict[str, object]:
        released.wait()
        return {"message": threading.current_thread().name}

    def fail(request: Any) -> None:
        raise ServiceFailed("no power")

    robot.advertise_service("/hold", "std_srvs/Trigger", hold, threaded=True).ready()
    robot.advertise_service("/fail", "std_srvs/Trigger", fail, threaded=True).ready()
    node.advertise_service("/release", "std_srvs/Trigger", lambda request: released.set())
    answers: list[str] = []
    waiting = threading.Thread(target=lambda: answers.append(user.call("/hold").message))
    waiting.start()
    with pytest.raises(ServiceFailed, match="no power"):
        user.call("/fail")
    user.call("/release")
    waiting.join()
    assert answers == ["rwt handler"]


def test_a_plain_function_executes_goals(sides: Sides) -> None:
    robot, user, _ = sides
    started = threading.Event()

    def count(goal: Any) -> dict[str, object]:
        goal.publish_feedback({"sequence": [goal.request.order]})
        if goal.request.order < 0:
            raise GoalAborted({"sequence": [7]}, "below zero")
        started.set()
        if goal.request.order > 100:
            while not goal.cancel_requested:
                threading.Event().wait(0.001)
            raise GoalCanceled({"sequence": [8]})
        return {"sequence": list(range(goal.request.order))}

    robot.advertise_action("/count", "example_interfaces/Fibonacci", count, threaded=True).ready()
    goal = user.send_goal("/count", {"order": 3})
    assert [list(each.sequence) for each in goal] == [[3]]
    assert list(goal.result().result.sequence) == [0, 1, 2]
    status, result = user.send_goal("/count", {"order": -1}).result()
    assert (status.name, list(result.sequence)) == ("ABORTED", [7])
    started.clear()
    goal = user.send_goal("/count", {"order": 1000})
    started.wait()
    goal.cancel()
    status, result = goal.result()
    assert (status.name, list(result.sequence)) == ("CANCELED", [8])


def test_the_goal_of_a_withdrawn_action_is_canceled_in_its_thread(sides: Sides) -> None:
    robot, user, _ = sides
    started, ended = threading.Event(), threading.Event()

    def wait(goal: Any) -> None:
        started.set()
        while not goal.cancel_requested:
            threading.Event().wait(0.001)
        ended.set()

    action = robot.advertise_action("/wait", "example_interfaces/Fibonacci", wait, threaded=True)
    action.ready()
    user.send_goal("/wait")
    started.wait()
    action.close()
    assert ended.wait(20)


def test_subscriptions_and_timers_run_in_threads(sides: Sides) -> None:
    robot, user, _ = sides
    heard: list[tuple[str, str]] = []
    ticked = threading.Event()

    def hear(message: Any) -> None:
        heard.append((message.data, threading.current_thread().name))

    robot.subscribe("/words", hear, "std_msgs/String", threaded=True).ready()
    timer = robot.create_timer(
        0.001, lambda: ticked.set() if "handler" in threading.current_thread().name else None, threaded=True
    )
    words = user.advertise("/words", "std_msgs/String")
    words.publish({"data": "one"})
    words.publish({"data": "two"})
    wait_until(lambda: len(heard) == 2)
    assert heard == [("one", "rwt handler"), ("two", "rwt handler")]
    assert ticked.wait(20)
    timer.cancel()


async def hear(message: Any) -> None:
    """Do nothing."""


OFFERS: list[Callable[[Robot], object]] = [
    lambda robot: robot.advertise_service("/s", "std_srvs/Trigger", hear, threaded=True),
    lambda robot: robot.advertise_action("/a", "example_interfaces/Fibonacci", hear, threaded=True),
    lambda robot: robot.subscribe("/t", hear, "std_msgs/String", threaded=True),
    lambda robot: robot.advertise_action("/a", "example_interfaces/Fibonacci", lambda goal: {}),
]


def test_a_function_of_the_wrong_kind_is_rejected(sides: Sides) -> None:
    for offer in OFFERS:
        with pytest.raises(TypeError, match=r"threaded=True"):
            offer(sides[0])


def test_the_pool_is_bounded_and_a_full_one_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    released = threading.Event()

    def hold(request: Any) -> None:
        released.wait()

    with Server("ws://127.0.0.1:0") as robot:
        threads: HandlerThreads = robot.node.graph.handler_threads
        threads.size = 2
        robot.advertise_service("/hold", "std_srvs/Trigger", hold, threaded=True)
        callers = [threading.Thread(target=robot.call, args=("/hold",)) for _ in range(5)]
        for caller in callers:
            caller.start()
        wait_until(lambda: threads.waiting == 3)
        page = urllib.request.urlopen(robot.server.urls[0].replace("ws", "http") + "/metrics")
        lines = page.read().decode().splitlines()
        assert {
            "rwt_handler_threads 2",
            "rwt_handler_threads_waiting 3",
            "rwt_handler_thread_waits_total 3",
        } <= set(lines)
        released.set()
        for caller in callers:
            caller.join()
        wait_until(lambda: threads.busy == 0)
    assert caplog.text.count("all 2 threads for handlers are busy: ") == 1


PROGRAM = """
import threading
from rwt import Server

stopped = threading.Event()

def read():
    stopped.wait(0.01)
    speeds.publish({"data": 1.0})

def drive():
    while not stopped.wait(0.001):
        speeds.publish({"data": 2.0})
    robot.log.info("the driver ends")

with Server("ws://127.0.0.1:0") as robot:
    speeds = robot.advertise("/speed", "std_msgs/Float64")
    robot.create_timer(0.001, read, threaded=True)
    driver = threading.Thread(target=drive)
    driver.start()
    try:
        robot.spin()
    finally:
        stopped.set()
        driver.join()
robot.log.info("the program ends")
"""


def test_threads_end_without_a_traceback_on_ctrl_c() -> None:
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert program.stdout is not None
    program.stdout.readline()  # The URLs: the threads run.
    program.send_signal(signal.SIGINT)
    _, errors = program.communicate(timeout=60)
    assert (program.returncode, b"Traceback" in errors) == (0, False), errors.decode()


def test_a_log_never_raises_after_the_end() -> None:
    with Server("ws://127.0.0.1:0") as robot:
        node = robot.server.node("driver")
    robot.log.info("late")
    node.log.error("late")


def test_a_handler_that_never_returns_does_not_keep_the_server() -> None:
    started = threading.Event()

    def hold(request: Any) -> None:
        started.set()
        threading.Event().wait()

    with Server("ws://127.0.0.1:0") as robot:
        robot.advertise_service("/hold", "std_srvs/Trigger", hold, threaded=True)
        robot.node.graph.soon(lambda: robot.node.graph.spawn(lambda: robot.node.call("/hold"), "call"))
        assert started.wait(20)
        assert all(thread.daemon for thread in threading.enumerate() if thread.name == "rwt handler")
