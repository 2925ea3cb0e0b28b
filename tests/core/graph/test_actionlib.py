from __future__ import annotations

from typing import TYPE_CHECKING

import anyio
import pytest

from rwt_graph import MemoryGraph, Node
from rwt_graph.nodes.actionlib import STATUS, ActionlibStatus
from rwt_participant.errors import GoalAborted, GoalCanceled
from rwt_participant.goals import GoalStatus, ReceivedGoal
from rwt_participant.messages import Message

if TYPE_CHECKING:
    from tests.core.graph.conftest import Advance

pytestmark = pytest.mark.anyio

ACTION = "actionlib_tutorials/Fibonacci"


class Client:
    """Actionlib client of ROS 1 on the five topics (ALB-01)."""

    def __init__(self, graph: MemoryGraph) -> None:
        node = Node(graph, "client")
        self.goal = node.advertise("/fib/goal", f"{ACTION}ActionGoal")
        self.cancel = node.advertise("/fib/cancel", "actionlib_msgs/GoalID")
        self.status: list[Message] = []
        self.feedback: list[Message] = []
        self.result: list[Message] = []
        node.subscribe("/fib/status", self.status.append, "actionlib_msgs/GoalStatusArray")
        node.subscribe("/fib/feedback", self.feedback.append, f"{ACTION}ActionFeedback")
        node.subscribe("/fib/result", self.result.append, f"{ACTION}ActionResult")

    def send(self, goal_id: str, order: int = 1, secs: int = 0) -> None:
        goal = {"goal_id": {"stamp": {"secs": secs, "nsecs": 0}, "id": goal_id}, "goal": {"order": order}}
        self.goal.publish(goal)

    def statuses(self) -> dict[str, int]:
        return {status.goal_id.id: status.status for status in self.status[-1].status_list}

    def results(self) -> list[tuple[str, int, str, list[int]]]:
        return [
            (r.status.goal_id.id, r.status.status, r.status.text, list(r.result.sequence))
            for r in self.result
        ]


async def count(goal: ReceivedGoal) -> dict[str, object]:
    if goal.request.order < 0:
        raise GoalAborted({"sequence": [-1]}, "cannot count down")
    goal.publish_feedback({"sequence": [goal.request.order]})
    if goal.request.order > 5:
        await goal.cancel_event.wait()
        raise GoalCanceled({"sequence": [9]})
    return {"sequence": list(range(goal.request.order))}


async def test_goals_by_topic(noetic: MemoryGraph, advance: Advance) -> None:
    async with noetic:
        Node(noetic, "server").advertise_action(
            "/fib", ACTION, count, accept=lambda goal: goal.order != 4 or "no fours"
        )
        client = Client(noetic)
        client.send("g1", 3, secs=5)
        client.send("g2", -1)
        client.send("g3", 4)
        client.send("g4", 6)
        client.send("g4", 6)
        await advance(0.05)
        assert sorted(client.results()) == [
            ("g1", ActionlibStatus.SUCCEEDED, "", [0, 1, 2]),
            ("g2", ActionlibStatus.ABORTED, "cannot count down", [-1]),
            ("g3", ActionlibStatus.REJECTED, "no fours", []),
        ]
        assert client.statuses() == {"g1": 3, "g2": 4, "g3": 5, "g4": 1}
        feedback = [
            (f.status.goal_id.id, f.status.status, list(f.feedback.sequence)) for f in client.feedback
        ]
        assert sorted(feedback) == [
            ("g1", 1, [3]),
            ("g4", 1, [6]),
        ]
        (first,) = [result for result in client.result if result.status.goal_id.id == "g1"]
        assert (first.status.goal_id.stamp.secs, first.header.stamp.secs) == (5, 1)
        await advance(6)
        assert client.statuses() == {"g4": 1}


async def test_status_comes_twice_a_second_without_any_goal(noetic: MemoryGraph, advance: Advance) -> None:
    async with noetic:
        Node(noetic, "server").advertise_action("/fib", ACTION, count)
        client = Client(noetic)
        await advance(2.0)
        assert len(client.status) == 4
        assert client.status[0].header.stamp.nsecs == 500_000_000
        assert client.statuses() == {}


@pytest.mark.parametrize(
    ("cancel", "expected"),
    [
        ({"id": "g1"}, {"g1"}),
        ({}, {"g1", "g2", "g3"}),
        ({"stamp": {"secs": 15}}, {"g1"}),
        ({"stamp": {"secs": 20}, "id": "g3"}, {"g1", "g2", "g3"}),
        ({"id": "unknown"}, set()),
    ],
)
async def test_cancelling(noetic: MemoryGraph, cancel: dict[str, object], expected: set[str]) -> None:
    async with noetic:
        Node(noetic, "server").advertise_action("/fib", ACTION, count)
        client = Client(noetic)
        for number in (1, 2, 3):
            client.send(f"g{number}", 6, secs=10 * number)
        await anyio.wait_all_tasks_blocked()
        client.cancel.publish(cancel)
        assert {goal for goal, status in client.statuses().items() if status == 6} == expected
        await anyio.wait_all_tasks_blocked()
        assert {goal for goal, status, _, _ in client.results()} == expected
        assert all(status == ActionlibStatus.PREEMPTED for _, status, _, _ in client.results())


async def test_an_action_of_ros_2_is_served_over_topics_too(graph: MemoryGraph, advance: Advance) -> None:
    async with graph:
        server = Node(graph, "server")
        server.advertise_action("/fib", "example_interfaces/Fibonacci", count)
        topics = server.serve_over_topics("/fib", ACTION)
        client = Client(graph)
        await advance(2.0)
        assert client.status == []
        client.send("one", order=2)
        await advance(0.1)
        assert client.statuses() == {"one": ActionlibStatus.SUCCEEDED}
        assert client.results() == [("one", ActionlibStatus.SUCCEEDED, "", [0, 1])]
        assert [list(message.feedback.sequence) for message in client.feedback] == [[2]]
        topics.close()
        client.send("two", order=2)
        await advance(0.1)
        assert len(client.result) == 1


async def test_a_goal_knows_whether_its_topic_is_listened_to(noetic: MemoryGraph, advance: Advance) -> None:
    goals: list[ReceivedGoal] = []

    async def run(goal: ReceivedGoal) -> None:
        goals.append(goal)
        await goal.cancel_event.wait()

    async with noetic:
        Node(noetic, "server").advertise_action("/fib", ACTION, run)
        node = Node(noetic, "client")
        heard: list[Message] = []
        feedback = node.subscribe("/fib/feedback", heard.append, f"{ACTION}ActionFeedback")
        node.advertise("/fib/goal", f"{ACTION}ActionGoal").publish({"goal_id": {"id": "one"}})
        await advance(1.0)
        assert [goal.feedback_wanted for goal in goals] == [True]
        feedback.close()
        await advance(1.0)
        assert [goal.feedback_wanted for goal in goals] == [False]
        goals[0].publish_feedback({"sequence": [1]})
        node.subscribe("/fib/feedback", heard.append, f"{ACTION}ActionFeedback")
        await advance(1.0)
        assert [goal.feedback_wanted for goal in goals] == [True]
        assert heard == []
        node.advertise("/fib/cancel", "actionlib_msgs/GoalID").publish({})


async def test_a_goal_without_an_id_gets_one(noetic: MemoryGraph) -> None:
    async with noetic:
        Node(noetic, "server").advertise_action("/fib", ACTION, count)
        client = Client(noetic)
        client.goal.publish({"goal": {"order": 1}})
        await anyio.wait_all_tasks_blocked()
        ((goal_id, status, _, _),) = client.results()
        assert goal_id == "/server-1-1.000000000"
        assert status == ActionlibStatus.SUCCEEDED


async def test_closing_tells_clients_and_leaves_the_topics(noetic: MemoryGraph, advance: Advance) -> None:
    async with noetic:
        action = Node(noetic, "server").advertise_action("/fib", ACTION, count)
        client = Client(noetic)
        client.send("g1", 6)
        await anyio.wait_all_tasks_blocked()
        action.close()
        assert client.results() == [("g1", ActionlibStatus.ABORTED, "Action /fib was unadvertised", [])]
        topic = noetic.topic("/fib/goal")
        assert topic is not None
        assert [endpoint.node for endpoint in topic.subscribers] == []
        before = len(client.status)
        await advance(2)
        assert len(client.status) == before


async def test_a_replaced_server_is_silent(noetic: MemoryGraph, advance: Advance) -> None:
    async with noetic:
        Node(noetic, "old").advertise_action("/fib", ACTION, count)
        Node(noetic, "new").advertise_action("/fib", ACTION, count)
        client = Client(noetic)
        client.send("g1", 2)
        await advance(0.6)
        assert client.results() == [("g1", ActionlibStatus.SUCCEEDED, "", [0, 1])]
        assert len(client.status) == 3


def test_every_state_has_its_number() -> None:
    assert set(STATUS) == set(GoalStatus)
