"""Reasons of goals that were rejected, aborted or canceled: in the log, in clients and on the wire."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from websockets.sync.client import connect as connect_websocket

from rwt import BlockingNode, GoalAborted, GoalCanceled, GoalRejected, Server
from rwt.cli import main
from rwt_client.blocking import BlockingRobot, connect

FIBONACCI = "example_interfaces/Fibonacci"
DENIED = "the vehicle answers MAV_RESULT_DENIED"


async def run(goal: Any) -> None:
    """End as the goal says: 0 waits until it is canceled, others are aborted."""
    if goal.request.order == 0:
        await goal.cancel_event.wait()
        raise GoalCanceled({"sequence": [9]}, "the operator took over")
    raise GoalAborted({"sequence": [7]}, DENIED)


def accept(goal: Any) -> bool | str:
    return goal.order >= 0 or "the battery is empty"


@pytest.fixture(params=["jazzy", "noetic"])
def robot(request: pytest.FixtureRequest) -> Iterator[BlockingNode]:
    with Server("ws://127.0.0.1:0", distro=request.param) as robot:
        robot.advertise_action("/run", FIBONACCI, run, accept=accept)
        yield robot


@pytest.fixture(params=["node", "client"])
def sender(request: pytest.FixtureRequest, robot: BlockingNode) -> Iterator[BlockingNode | BlockingRobot]:
    with ExitStack() as stack:
        yield (robot if request.param == "node" else stack.enter_context(connect(robot.server.urls[0])))


def test_senders_and_the_log_have_the_reason(
    robot: BlockingNode, sender: BlockingNode | BlockingRobot, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    aborted = sender.send_goal("/run", {"order": 1})
    status, result = aborted.result()
    assert (status.name, list(result.sequence), aborted.reason) == ("ABORTED", [7], DENIED)
    canceled = sender.send_goal("/run", {"order": 0})
    canceled.cancel()
    status, result = canceled.result()
    assert (status.name, list(result.sequence)) == ("CANCELED", [9])
    assert canceled.reason == "the operator took over"
    with pytest.raises(GoalRejected, match="the battery is empty"):
        sender.send_goal("/run", {"order": -1}).result()
    for line in (f"aborted: {DENIED}", "canceled: the operator took over", "rejected: the battery is empty"):
        assert line in caplog.text


def test_a_client_that_offers_an_action_gives_reasons() -> None:
    with Server("ws://127.0.0.1:0") as robot, connect(robot.server.urls[0]) as client:
        client.advertise_action("/run", FIBONACCI, run).ready()
        goal = robot.send_goal("/run", {"order": 1})
        assert goal.result().status.name == "ABORTED"
        assert goal.reason == DENIED


def test_the_wire_carries_the_reason() -> None:
    with Server("ws://127.0.0.1:0") as robot:
        robot.advertise_action("/run", FIBONACCI, run, accept=accept)
        with connect_websocket(robot.server.urls[0]) as socket:
            goal = {"op": "send_action_goal", "action": "/run", "action_type": FIBONACCI, "id": "g"}
            socket.send(json.dumps({**goal, "args": {"order": 1}}))
            ended = json.loads(socket.recv(10))
            assert (ended["values"], ended["status"], ended["reason"]) == ({"sequence": [7]}, 6, DENIED)
            socket.send(json.dumps({**goal, "args": {"order": -1}}))
            rejected = json.loads(socket.recv(10))
            assert (rejected["values"], rejected["result"]) == ("the battery is empty", False)
            assert "reason" not in rejected


def test_the_command_line_prints_the_reason(robot: BlockingNode, capsys: pytest.CaptureFixture[str]) -> None:
    url = robot.server.urls[0]
    line = ["action", "send_goal", "/run", FIBONACCI, "{order: 1}", "--url", url]
    assert main(line) != 0
    assert f"the goal of /run ended as ABORTED: {DENIED}" in capsys.readouterr().err
    assert main([*line, "--json"]) != 0
    assert json.loads(capsys.readouterr().out)["reason"] == DENIED
    assert main([*line[:4], "{order: -1}", "--url", url]) != 0
    assert "the battery is empty" in capsys.readouterr().err
