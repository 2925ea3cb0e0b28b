"""Actions: sending goals, of ROS 2 and of ROS 1, and offering."""

from __future__ import annotations

from typing import Any

import anyio
import anyio.lowlevel
import pytest

from rwt_client import ConnectionLost
from rwt_interfaces import NOETIC
from rwt_participant.errors import CallFailed, GoalAborted, GoalCanceled, ProviderNotFound, TimedOut
from rwt_participant.goals import GoalStatus, ReceivedGoal
from tests.core.client.worlds import World, scripted, world

pytestmark = pytest.mark.anyio

FIBONACCI = "example_interfaces/Fibonacci"


def offer_fibonacci(it: World) -> None:
    """An action of the robot: counts up, or waits to be canceled when the order is 0."""

    async def execute(goal: ReceivedGoal) -> dict[str, object]:
        order = goal.request.order
        for number in range(1, order):
            goal.publish_feedback({"sequence": list(range(number))})
            await anyio.lowlevel.checkpoint()
        if order == 0:
            await goal.cancel_event.wait()
            raise GoalCanceled({"sequence": [9]})
        return {"sequence": list(range(order))}

    it.node.advertise_action("/fibonacci", FIBONACCI, execute)


async def test_a_goal_gives_feedback_and_a_result(transport: str) -> None:
    async with world(transport) as it:
        offer_fibonacci(it)
        goal = await it.robot.send_goal("/fibonacci", {"order": 3})
        assert [feedback.sequence async for feedback in goal] == [[0], [0, 1]]
        outcome = await goal.result()
        assert (outcome.status, outcome.result.sequence) == (GoalStatus.SUCCEEDED, [0, 1, 2])
        assert outcome.succeeded
        assert goal.done


async def test_feedback_may_be_called_back() -> None:
    async with world() as it:
        offer_fibonacci(it)
        heard: list[Any] = []
        goal = await it.robot.send_goal("/fibonacci", {"order": 3}, FIBONACCI, on_feedback=heard.append)
        await goal.result()
        assert [feedback.sequence for feedback in heard] == [[0], [0, 1]]


async def test_a_goal_is_canceled() -> None:
    async with world() as it:
        offer_fibonacci(it)
        goal = await it.robot.send_goal("/fibonacci", {"order": 0})
        goal.cancel()
        assert goal.status is GoalStatus.CANCELING
        outcome = await goal.result(timeout=5)
        assert (outcome.status, outcome.result.sequence) == (GoalStatus.CANCELED, [9])
        goal.cancel()


async def test_a_failure_carries_the_servers_words() -> None:
    async with world() as it:
        goal = await it.robot.send_goal("/nope", {}, FIBONACCI)
        with pytest.raises(CallFailed, match=r"^Action /nope does not exist$"):
            await goal.result()
        with pytest.raises(CallFailed):
            async for _ in goal:
                pass
        with pytest.raises(ProviderNotFound, match="the robot knows no action /nope"):
            await it.robot.send_goal("/nope")


async def test_a_goal_is_not_lost_silently() -> None:
    async with scripted() as (server, robot):
        goal = await robot.send_goal("/fibonacci", {"order": 5}, FIBONACCI)
        await server.hears("send_action_goal")
        server.hang_up(reason="the cable was pulled")
        with pytest.raises(ConnectionLost, match="the cable was pulled, before the goal of /fibonacci ended"):
            await goal.result()
        await server.hears("set_level", 2)
        assert len(server.ops("send_action_goal")) == 1


async def test_what_is_sent() -> None:
    async with scripted() as (server, robot):
        goal = await robot.send_goal("/fibonacci", {"order": 5}, FIBONACCI)
        op = await server.hears("send_action_goal")
        assert op == {
            "op": "send_action_goal",
            "id": goal.id,
            "action": "/fibonacci",
            "action_type": "example_interfaces/action/Fibonacci",
            "args": {"order": 5},
            "feedback": True,
        }
        goal.cancel()
        cancel = await server.hears("cancel_action_goal")
        assert (cancel["id"], cancel["action"]) == (goal.id, "/fibonacci")


class TestInVirtualTime:
    @pytest.fixture
    def anyio_backend(self, virtual_time: object) -> object:
        return virtual_time

    async def test_a_result_is_not_waited_for_longer_than_asked(self) -> None:
        async with scripted() as (_, robot):
            goal = await robot.send_goal("/fibonacci", {"order": 5}, FIBONACCI)
            with pytest.raises(TimedOut, match="the goal of /fibonacci has not ended within 3 s"):
                await goal.result(timeout=3)
            assert not goal.done


# -- ROS 1 ---------------------------------------------------------------------------------------------------


async def test_a_goal_of_ros_1_goes_over_topics() -> None:
    async with world(distro="noetic") as it:
        assert it.robot.types.distro is NOETIC
        offer_fibonacci(it)
        goal = await it.robot.send_goal("/fibonacci", {"order": 3}, FIBONACCI)
        assert (await goal.result(timeout=5)).result.sequence == [0, 1, 2]
        canceled = await it.robot.send_goal("/fibonacci", {"order": 0}, FIBONACCI)
        canceled.cancel()
        assert (await canceled.result(timeout=5)).status is GoalStatus.CANCELED


# -- offering ------------------------------------------------------------------------------------------------


async def count(goal: ReceivedGoal) -> dict[str, object]:
    """An action of the client: as the robot's, and it may go wrong in all ways."""
    order = goal.request.order
    if order == 0:
        await goal.cancel_event.wait()
        assert goal.cancel_requested
        raise GoalCanceled({"sequence": [7]})
    if order == -1:
        raise GoalAborted({"sequence": [8]})
    if order == -2:
        raise ZeroDivisionError("secret detail")
    if order == -3:
        return {"sequenze": []}
    for number in range(1, order):
        goal.publish_feedback({"sequence": list(range(number))})
    return {"sequence": list(range(order))}


async def test_an_action_is_offered(transport: str) -> None:
    async with world(transport) as it:
        with await it.robot.advertise_action("/count", FIBONACCI, count):
            await it.arrives(lambda: it.graph.action("/count"))
            heard: list[Any] = []
            handle = await it.node.send_goal("/count", {"order": 3}, on_feedback=heard.append)
            status, result = await handle.result()
            assert (int(status), result.sequence) == (4, [0, 1, 2])
            assert [feedback.sequence for feedback in heard] == [[0], [0, 1]]
        await it.arrives(lambda: it.graph.action("/count") is None)


async def test_an_offered_goal_is_canceled() -> None:
    async with world() as it:
        await it.robot.advertise_action("/count", FIBONACCI, count)
        await it.arrives(lambda: it.graph.action("/count"))
        goal = await it.robot.send_goal("/count", {"order": 0})
        goal.cancel()
        outcome = await goal.result(timeout=5)
        assert (outcome.status, outcome.result.sequence) == (GoalStatus.CANCELED, [7])


@pytest.mark.parametrize("order", [-1, -2, -3])
async def test_an_offered_goal_that_goes_wrong_is_aborted(order: int) -> None:
    async with world() as it:
        await it.robot.advertise_action("/count", FIBONACCI, count)
        await it.arrives(lambda: it.graph.action("/count"))
        goal = await it.robot.send_goal("/count", {"order": order})
        outcome = await goal.result(timeout=5)
        assert outcome.status is GoalStatus.ABORTED
        assert outcome.result.sequence == ([8] if order == -1 else [])


async def test_why_an_offered_goal_failed_is_told_without_details() -> None:
    async with scripted() as (server, robot):
        await robot.advertise_action("/count", FIBONACCI, count)
        for number, order in enumerate((-2, -3), 1):
            goal = {
                "action": "/count",
                "action_type": FIBONACCI,
                "args": {"order": order},
                "id": f"g{number}",
            }
            server.say({"op": "send_action_goal", **goal})
            answer = await server.hears("action_result", number)
            assert (answer["id"], answer["result"], answer["status"]) == (f"g{number}", False, 6)
        reasons = [answer["values"] for answer in server.ops("action_result")]
        assert reasons[0] == "the action failed; its program's log says why"
        assert reasons[1].startswith("example_interfaces/Fibonacci_Result has no field ")


async def test_goals_end_when_the_connection_is_lost() -> None:
    ended = anyio.Event()

    async def wait(goal: ReceivedGoal) -> None:
        await goal.cancel_event.wait()
        ended.set()

    async with scripted() as (server, robot):
        await robot.advertise_action("/wait", FIBONACCI, wait)
        await server.hears("advertise_action")
        server.say({"op": "send_action_goal", "action": "/wait", "action_type": FIBONACCI, "id": "g1"})
        server.hang_up()
        with anyio.fail_after(5):
            await ended.wait()
        await server.hears("advertise_action", 2)
        assert server.ops("action_result") == []
