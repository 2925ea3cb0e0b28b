"""Actions: sending goals, of ROS 2 and of ROS 1, and offering."""

from __future__ import annotations

from typing import Any

import anyio
import anyio.lowlevel
import pytest

from rwt_client import ConnectionLost
from rwt_interfaces import NOETIC
from rwt_participant.errors import GoalCanceled
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


async def test_feedback_may_be_called_back() -> None:
    async with world() as it:
        offer_fibonacci(it)
        heard: list[Any] = []
        goal = await it.robot.send_goal("/fibonacci", {"order": 3}, FIBONACCI, on_feedback=heard.append)
        await goal.result()
        assert [feedback.sequence for feedback in heard] == [[0], [0, 1]]


async def test_a_goal_is_not_lost_silently() -> None:
    async with scripted() as (server, robot):
        goal = await robot.send_goal("/fibonacci", {"order": 5}, FIBONACCI)
        await server.hears("send_action_goal")
        server.hang_up(reason="the cable was pulled")
        with pytest.raises(ConnectionLost, match="the cable was pulled, before the goal of /fibonacci ended"):
            await goal.result()
        await server.hears("set_level", 2)
        assert len(server.ops("send_action_goal")) == 1


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
    """An action of the client that goes wrong."""
    if goal.request.order == -2:
        raise ZeroDivisionError("secret detail")
    return {"sequenze": []}


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
