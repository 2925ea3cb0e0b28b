"""`on_emergency_stop` of nodes and clients."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any, TypeAlias

import pytest

from rwt import BlockingNode, Server
from rwt_client.blocking import BlockingRobot, connect
from tests.waiting import wait_until

Robot: TypeAlias = "BlockingNode | BlockingRobot"
GATE: dict[str, Any] = {"rules": {"drive": {"topics": ["/cmd_vel"], "emergency": True, "stop": {}}}}


@pytest.fixture
def node() -> Iterator[BlockingNode]:
    with Server("ws://127.0.0.1:0", gate=GATE) as robot:
        yield robot


@pytest.fixture(params=["node", "client"])
def robot(request: pytest.FixtureRequest, node: BlockingNode) -> Iterator[Robot]:
    with ExitStack() as stack:
        yield node if request.param == "node" else stack.enter_context(connect(node.server.urls[0]))


def press(node: BlockingNode, service: str = "/gate/stop") -> None:
    with connect(node.server.urls[0]) as operator:
        operator.call(service, {"reason": "smoke"})


def test_the_stop_and_its_release_are_called_once_each(node: BlockingNode, robot: Robot) -> None:
    called: list[str] = []
    handle = robot.on_emergency_stop(lambda: called.append("stop"), lambda: called.append("release"))
    press(node)
    press(node)
    wait_until(lambda: called == ["stop"])
    press(node, "/gate/release_stop")
    wait_until(lambda: called == ["stop", "release"])
    handle.close()
    press(node)
    robot.clock.sleep(0.0)
    assert called == ["stop", "release"]


def test_a_stop_that_was_pressed_before_is_called(node: BlockingNode, robot: Robot) -> None:
    press(node)
    stopped = threading.Event()
    robot.on_emergency_stop(stopped.set)
    assert stopped.wait(20)
    press(node, "/gate/release_stop")


def test_a_stop_that_fails_is_called_again(node: BlockingNode, robot: Robot) -> None:
    called: list[int] = []

    def stop() -> None:
        called.append(1)
        if len(called) < 3:
            raise OSError("the bus is busy")

    robot.on_emergency_stop(stop)
    press(node)
    wait_until(lambda: len(called) == 3)


async def pause() -> None:
    """Do nothing."""


def test_coroutine_functions_are_rejected(robot: Robot) -> None:
    with pytest.raises(TypeError, match="expected plain functions"):
        robot.on_emergency_stop(pause)  # type: ignore[arg-type]
