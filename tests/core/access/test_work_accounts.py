"""Charges of requests that a robot's program still holds.

They stay charged to their client until the program is done, also if the client has left.
"""

from __future__ import annotations

from typing import Any

import anyio
import anyio.lowlevel
import pytest

from rwt import Settings
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.registry import Registry
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message
from tests.conftest import REGISTRIES
from tests.core.rosbridge.recording_client import Client

pytestmark = pytest.mark.anyio

KEPT = 12_500
LONG = "x" * 3000
GOALS = "control_msgs/FollowJointTrajectory"


def _graph(registry: Registry) -> tuple[MemoryGraph, SimulatedClock]:
    clock = SimulatedClock(1_700_000_000 * 10**9)
    return MemoryGraph(registry, clock), clock


def _client(graph: MemoryGraph, **limits: int) -> Client:
    bridge = Bridge(graph, Settings.model_validate({"limits": {"kept_bytes": KEPT, **limits}}))
    client = Client(bridge, "192.0.2.1")
    client.say("set_level", level="error")
    return client


def _results(client: Client, id_: str) -> list[Any]:
    return [heard for heard in client.heard() if heard.get("id") == id_]


async def _settled() -> None:
    """Let tasks that were started come to where they wait."""
    for _ in range(50):
        await anyio.lowlevel.checkpoint()


async def test_a_call_that_timed_out_is_charged_until_its_coroutine_has_ended() -> None:
    graph, clock = _graph(REGISTRIES["jazzy"])
    ends, begun = anyio.Event(), 0

    async def slow(asked: Message) -> dict[str, object]:
        nonlocal begun
        begun += 1
        await ends.wait()
        return {}

    async with graph:
        Node(graph, "robot").advertise_service("/slow", "rcl_interfaces/SetParameters", slow)
        client = _client(graph)

        def call(id_: str) -> None:
            args = {"parameters": [{"name": LONG}]}
            client.say("call_service", service="/slow", args=args, id=id_, timeout=0.5)

        for number in range(3):
            call(str(number))
            await _settled()
            clock.advance(1.0)
            assert "Timeout" in str(client.heard())
        assert begun == 3
        call("one too many")
        await _settled()
        assert "limits.kept_bytes" in str(client.heard()) and begun == 3
        ends.set()
        await _settled()
        call("again")
        await _settled()
        assert begun == 4


async def test_small_calls_whose_coroutines_never_end_are_counted() -> None:
    graph, clock = _graph(REGISTRIES["jazzy"])

    async def never(asked: Message) -> dict[str, object]:
        await anyio.sleep_forever()
        raise AssertionError

    async with graph:
        Node(graph, "robot").advertise_service("/never", "std_srvs/Trigger", never)
        client = _client(graph, calls=5)
        for number in range(6):
            client.say("call_service", service="/never", id=str(number), timeout=0.5)
            await _settled()
            clock.advance(1.0)
        assert "limits.calls" in str(client.heard())


class ActionRobot:
    """A robot of ROS 1 with an action that ends its goals when it is told to."""

    def __init__(self, graph: MemoryGraph) -> None:
        self.ends = anyio.Event()
        self.begun = 0
        Node(graph, "robot").advertise_action("/arm", GOALS, self._run)

    async def _run(self, goal: ReceivedGoal) -> dict[str, object]:
        self.begun += 1
        await self.ends.wait()
        return {}


def _send(client: Client, id_: str, name: str = LONG) -> None:
    msg = {"goal_id": {"id": id_}, "goal": {"trajectory": {"joint_names": [name]}}}
    client.say("publish", topic="/arm/goal", type=f"{GOALS}ActionGoal", msg=msg)


async def test_goals_that_are_sent_as_messages_are_charged_until_they_end() -> None:
    graph, _ = _graph(REGISTRIES["noetic"])
    async with graph:
        robot = ActionRobot(graph)
        client = _client(graph)
        client.say("subscribe", topic="/arm/result", type=f"{GOALS}ActionResult")
        for number in range(5):
            _send(client, f"goal {number}")
        await _settled()
        rejected = [heard["msg"]["status"] for heard in client.heard() if heard["op"] == "publish"]
        assert [status["goal_id"]["id"] for status in rejected] == ["goal 3", "goal 4"]
        assert all(status["status"] == 5 and "limits.kept_bytes" in status["text"] for status in rejected)
        assert robot.begun == 3
        robot.ends.set()
        await _settled()
        _send(client, "goal 5")
        await _settled()
        assert robot.begun == 4


async def test_goals_go_on_being_charged_to_the_address_of_who_has_left() -> None:
    graph, _ = _graph(REGISTRIES["noetic"])
    async with graph:
        robot = ActionRobot(graph)
        bridge = Bridge(graph, Settings.model_validate({"limits": {"kept_bytes": KEPT}}))
        for number in range(8):
            client = Client(bridge, "192.0.2.1")
            for each in range(3):
                _send(client, f"{number} {each}")
            client.leave()
        await _settled()
        assert 12 <= robot.begun <= 13, "four times what one may have"
        robot.ends.set()
        await _settled()
        _send(Client(bridge, "192.0.2.1"), "later")
        await _settled()
        assert robot.begun >= 13


async def test_ended_goals_and_their_ids_are_bounded() -> None:
    graph, clock = _graph(REGISTRIES["noetic"])
    async with graph:
        robot = ActionRobot(graph)
        robot.ends.set()
        client = _client(graph)
        client.say("subscribe", topic="/arm/status", type="actionlib_msgs/GoalStatusArray")
        for number in range(150):
            _send(client, f"goal {number}", "x")
            if number % 10 == 0:
                await _settled()
        await _settled()
        clock.advance(0.6)
        (*_, last) = [heard["msg"]["status_list"] for heard in client.heard() if heard["op"] == "publish"]
        assert len(last) == 100 and last[-1]["goal_id"]["id"] == "goal 149"
        begun = robot.begun
        _send(client, "i" * 300)
        await _settled()
        assert robot.begun == begun == 150
