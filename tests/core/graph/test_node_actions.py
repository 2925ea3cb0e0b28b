from __future__ import annotations

from typing import TYPE_CHECKING

import anyio
import pytest

from rwt_graph import MemoryGraph, Node
from rwt_interfaces.errors import InvalidMessage
from rwt_participant.errors import GoalAborted, GoalCanceled, GoalRejected, NotFound, ProviderGone
from rwt_participant.goals import GoalStatus, ReceivedGoal
from rwt_participant.messages import Message

if TYPE_CHECKING:
    pass

pytestmark = pytest.mark.anyio

FIBONACCI = "example_interfaces/Fibonacci"


async def count(goal: ReceivedGoal) -> dict[str, object]:
    """One number a second, until it is cancelled."""
    sequence = [0, 1]
    while len(sequence) < goal.request.order:
        with anyio.move_on_after(0):
            await goal.cancel_event.wait()
        if goal.cancel_requested:
            raise GoalCanceled({"sequence": sequence})
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback({"sequence": sequence})
    return {"sequence": sequence}


async def wait_for_cancel(goal: ReceivedGoal) -> None:
    await goal.cancel_event.wait()
    raise GoalCanceled(reason="as asked")


async def test_success_with_feedback(node: Node) -> None:
    node.advertise_action("fib", FIBONACCI, count)
    feedback: list[Message] = []
    handle = await node.send_goal("/fib", {"order": 4}, on_feedback=feedback.append)
    status, result = await handle.result()
    assert (status, result.sequence) == (GoalStatus.SUCCEEDED, [0, 1, 1, 2])
    assert [message.sequence for message in feedback] == [[0, 1, 1], [0, 1, 1, 2]]
    assert (await handle.result())[0] is handle.status is GoalStatus.SUCCEEDED
    assert handle.reason == ""


async def test_cancel_by_handle_and_by_id(graph: MemoryGraph) -> None:
    async with graph:
        node, other = Node(graph, "n"), Node(graph, "other")
        node.advertise_action("/fib", FIBONACCI, wait_for_cancel)
        first = await node.send_goal("/fib")
        second = await node.send_goal("/fib", goal_id="c" * 32)
        assert (first.status, second.status) == (GoalStatus.EXECUTING, GoalStatus.EXECUTING)
        first.cancel()
        other.cancel_goal("fib", "c" * 32)
        for handle in (first, second):
            status, result = await handle.result()
            assert (status, list(result.sequence)) == (GoalStatus.CANCELED, [])
            assert handle.reason == "as asked"


async def test_rejections(node: Node) -> None:
    verdicts: list[bool | str] = []

    def accept(goal: Message) -> bool | str:
        if goal.order < 0:
            raise ValueError("negative")
        return verdicts.pop()

    node.advertise_action("/fib", FIBONACCI, count, accept=accept)
    verdicts[:] = [True, "too busy", False]
    with pytest.raises(GoalRejected, match="action /fib rejected the goal"):
        await node.send_goal("/fib")
    with pytest.raises(GoalRejected, match=r"^too busy$"):
        await node.send_goal("/fib")
    with pytest.raises(GoalRejected, match=r"^negative$"):
        await node.send_goal("/fib", {"order": -1})
    assert (await (await node.send_goal("/fib")).result())[0] is GoalStatus.SUCCEEDED
    with pytest.raises(NotFound, match="Action /nope does not exist"):
        await node.send_goal("/nope")
    with pytest.raises(InvalidMessage, match="order: "):
        await node.send_goal("/fib", {"order": "many"})


@pytest.mark.parametrize(
    ("error", "reason", "sequence"),
    [
        (GoalAborted({"sequence": [5]}, "stuck"), "stuck", [5]),
        (ValueError("broken"), "broken", []),
        (GoalCanceled({"sequence": [1]}), "is EXECUTING: CANCELED is not possible", []),
        (GoalAborted({"sequence": "wrong"}, "stuck"), "sequence: ", []),
    ],
)
async def test_goals_that_end_badly(node: Node, error: Exception, reason: str, sequence: list[int]) -> None:
    async def execute(_goal: ReceivedGoal) -> None:
        raise error

    node.advertise_action("/fib", FIBONACCI, execute)
    handle = await node.send_goal("/fib")
    status, result = await handle.result()
    assert (status, list(result.sequence)) == (GoalStatus.ABORTED, sequence)
    assert reason in handle.reason


async def test_a_withdrawn_action_cancels_what_runs(node: Node, graph: MemoryGraph) -> None:
    ended: list[str] = []

    async def execute(_goal: ReceivedGoal) -> None:
        try:
            await anyio.sleep_forever()
        finally:
            ended.append("execute")

    action = node.advertise_action("/fib", FIBONACCI, execute)
    handle = await node.send_goal("/fib")
    await anyio.wait_all_tasks_blocked()
    action.close()
    with pytest.raises(ProviderGone, match="Action /fib was unadvertised"):
        await handle.result()
    await anyio.wait_all_tasks_blocked()
    assert ended == ["execute"]
    # Withdrawn between acceptance and the start of the task: it must not run at all.
    action = node.advertise_action("/fib", FIBONACCI, execute)
    await node.send_goal("/fib")
    action.close()
    await anyio.wait_all_tasks_blocked()
    assert graph.action("/fib") is None


async def test_a_goal_knows_whether_its_feedback_is_wanted(node: Node) -> None:
    goals: dict[int, ReceivedGoal] = {}

    async def run(goal: ReceivedGoal) -> None:
        goals[goal.request.order] = goal
        await goal.cancel_event.wait()

    def wanted() -> dict[int, bool]:
        return {order: goal.feedback_wanted for order, goal in goals.items()}

    node.advertise_action("fib", FIBONACCI, run)
    with_feedback = await node.send_goal("/fib", {"order": 1}, on_feedback=lambda message: None)
    await node.send_goal("/fib", {"order": 2})
    await anyio.wait_all_tasks_blocked()
    assert wanted() == {1: True, 2: True}
    with_feedback.abandon()
    assert wanted() == {1: False, 2: True}


async def test_before_the_graph_runs_goals_are_rejected(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    node.advertise_action("/fib", FIBONACCI, count)
    with pytest.raises(GoalRejected, match="the graph is not running"):
        await node.send_goal("/fib")


async def test_plain_functions_cannot_execute(graph: MemoryGraph) -> None:
    with pytest.raises(TypeError, match="must be a coroutine function"):
        Node(graph, "n").advertise_action("/fib", FIBONACCI, lambda _: {"sequence": []})
