from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import pytest

from rwt_graph import InvalidGraphName, InvalidTransition
from rwt_graph.api import GoalEvents, Registration, ServerGoal
from rwt_participant.goals import GoalStatus
from tests.contract.graph.harness import CLIENTS, GoalDiary

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.contract.graph.harness import Harness

pytestmark = pytest.mark.anyio


class Server:
    """An action server that keeps its goals; `on_goal` does what a test wants with a new one."""

    def __init__(self, harness: Harness, node: str = "/server") -> None:
        self.goals: list[ServerGoal] = []
        self.messages: list[bytes | memoryview] = []
        self.heard: list[str] = []
        self.on_goal: Callable[[ServerGoal], None] = lambda goal: goal.accept()
        self.participant = harness.graph.participant(node)
        self.registration: Registration = self.participant.advertise_action(
            "/fib", harness.graph.registry.action(harness.fibonacci), self._on_goal
        )

    def _on_goal(self, goal: ServerGoal) -> None:
        self.goals.append(goal)
        self.messages.append(goal.goal.json())
        goal.on_cancel = lambda: self.heard.append("cancel")
        goal.on_end = lambda gone: self.heard.append(str(gone))
        self.on_goal(goal)


@pytest.fixture
async def server(harness: Harness) -> Server:
    made = Server(harness)
    await harness.settle()
    return made


async def test_a_goal_from_beginning_to_success(harness: Harness, server: Server, diary: GoalDiary) -> None:
    goal = harness.graph.participant("/c").send_goal("/fib", harness.goal(3), diary.events)
    await harness.settle()
    assert diary.heard == ["accepted"]
    (served,) = server.goals
    assert (served.id, served.action, served.status) == (goal.id, "/fib", GoalStatus.EXECUTING)
    assert server.messages == [harness.goal(3).json()]
    with pytest.raises(InvalidTransition, match="not kept"):
        _ = served.goal
    served.feedback(harness.sequence(0, 1, part="feedback"))
    served.finish(GoalStatus.SUCCEEDED, harness.sequence(0, 1, 1))
    served.feedback(harness.sequence(9, part="feedback"))
    await harness.settle()
    assert diary.heard == ["accepted", [0, 1], (GoalStatus.SUCCEEDED, [0, 1, 1])]
    assert goal.status is GoalStatus.SUCCEEDED


async def test_a_rejected_goal(harness: Harness, server: Server, diary: GoalDiary) -> None:
    server.on_goal = lambda goal: goal.reject("not today")
    goal = harness.graph.participant("/c").send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    assert diary.heard == [(GoalStatus.UNKNOWN, "GoalRejected: not today")]
    assert goal.reason == "not today"
    with pytest.raises(InvalidTransition):
        server.goals[0].reject("again")


async def test_an_unknown_action_is_a_result(harness: Harness, diary: GoalDiary) -> None:
    harness.graph.participant("/c").send_goal("/nope", harness.goal(), diary.events)
    await harness.settle()
    assert diary.heard == [(GoalStatus.UNKNOWN, "ProviderNotFound: Action /nope does not exist")]


async def test_cancel_is_asked_once_and_granted(harness: Harness, server: Server, diary: GoalDiary) -> None:
    goal = harness.graph.participant("/c").send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    goal.cancel()
    goal.cancel()
    await harness.settle()
    assert server.heard == ["cancel"]
    served = server.goals[0]
    assert served.cancel_requested
    assert served.status is GoalStatus.CANCELING
    served.finish(GoalStatus.CANCELED, harness.sequence(7), "as you wish")
    await harness.settle()
    assert diary.heard == ["accepted", (GoalStatus.CANCELED, [7])]
    assert goal.reason == "as you wish"
    goal.cancel()
    await harness.settle()
    assert server.heard == ["cancel"]


async def test_a_server_may_finish_although_asked_to_cancel(
    harness: Harness, server: Server, diary: GoalDiary
) -> None:
    goal = harness.graph.participant("/c").send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    goal.cancel()
    await harness.settle()
    server.goals[0].finish(GoalStatus.SUCCEEDED, harness.sequence())
    await harness.settle()
    assert goal.status is GoalStatus.SUCCEEDED


async def test_canceled_needs_a_cancel(harness: Harness, server: Server, diary: GoalDiary) -> None:
    harness.graph.participant("/c").send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    with pytest.raises(InvalidTransition, match="is EXECUTING: CANCELED is not possible"):
        server.goals[0].finish(GoalStatus.CANCELED, harness.sequence())
    with pytest.raises(InvalidTransition, match="EXECUTING, which is not an end"):
        server.goals[0].finish(GoalStatus.EXECUTING, harness.sequence())
    server.goals[0].finish(GoalStatus.ABORTED, harness.sequence())
    with pytest.raises(InvalidTransition):
        server.goals[0].finish(GoalStatus.ABORTED, harness.sequence())


async def test_a_cancel_before_acceptance_waits_for_it(
    harness: Harness, server: Server, diary: GoalDiary
) -> None:
    server.on_goal = lambda _: None
    goal = harness.graph.participant("/c").send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    goal.cancel()
    await harness.settle()
    assert server.heard == []
    server.goals[0].accept()
    await harness.settle()
    assert server.heard == ["cancel"]
    assert diary.heard == ["accepted"]


async def test_another_client_cancels_by_id(harness: Harness, server: Server, diary: GoalDiary) -> None:
    sender, other = harness.graph.participant("/c"), harness.graph.participant("/other")
    goal = sender.send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    other.cancel_goal("/fib", "0" * 32)
    other.cancel_goal("/nope", goal.id)
    await harness.settle()
    assert server.heard == []
    other.cancel_goal("/fib", goal.id)
    await harness.settle()
    assert server.heard == ["cancel"]


async def test_all_goals_of_an_action_are_cancelled_whoever_sent_them(
    harness: Harness, server: Server, diary: GoalDiary
) -> None:
    for name in ("/c", "/d"):
        harness.graph.participant(name).send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    other = harness.graph.participant("/other")
    assert list(other.cancel_every_goal("/nope")) == []
    await harness.settle()
    assert server.heard == []
    for _ in other.cancel_every_goal("/fib"):
        pass
    await harness.settle()
    assert server.heard == ["cancel", "cancel"]


@pytest.mark.parametrize("how", ["registration", "participant", "replaced"])
async def test_goals_are_lost_with_their_server(
    harness: Harness, server: Server, diary: GoalDiary, how: str
) -> None:
    goal = harness.graph.participant("/c").send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    if how == "registration":
        server.registration.close()
    elif how == "participant":
        server.participant.close()
    else:
        Server(harness, "/new")
    await harness.settle()
    assert goal.status is GoalStatus.ABORTED
    assert diary.heard == ["accepted", (GoalStatus.ABORTED, "ProviderGone: Action /fib was unadvertised")]
    assert server.heard == ["Action /fib was unadvertised"]
    info = harness.graph.action("/fib")
    assert (info.node if info else None) == ("/new" if how == "replaced" else None)
    with pytest.raises(InvalidTransition):
        server.goals[0].finish(GoalStatus.SUCCEEDED, harness.sequence())


@pytest.mark.parametrize("how", ["abandon", "close"])
async def test_an_abandoned_goal_runs_on_unheard(
    harness: Harness, server: Server, diary: GoalDiary, how: str
) -> None:
    client = harness.graph.participant("/c")
    goal = client.send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    goal.abandon() if how == "abandon" else client.close()
    await harness.settle()
    served = server.goals[0]
    assert served.status is GoalStatus.EXECUTING
    assert not served.cancel_requested
    served.feedback(harness.sequence(1, part="feedback"))
    served.finish(GoalStatus.SUCCEEDED, harness.sequence())
    await harness.settle()
    closed = (GoalStatus.EXECUTING, "CallFailed: node /c was closed")
    assert diary.heard == (["accepted"] if how == "abandon" else ["accepted", closed])


async def test_goals_run_side_by_side_and_ids_are_unique(
    harness: Harness, server: Server, diary: GoalDiary
) -> None:
    client = harness.graph.participant("/c")
    chosen = "ab" * 16
    first = client.send_goal("/fib", harness.goal(), GoalEvents(lambda *_: None), chosen)
    second = client.send_goal("/fib", harness.goal(), GoalEvents(lambda *_: None))
    twin = client.send_goal("/fib", harness.goal(), diary.events, chosen)
    await harness.settle()
    assert first.id == chosen
    assert first.id != second.id
    assert [goal.id for goal in server.goals] == [first.id, second.id]
    ((_, error),) = diary.heard
    assert error.startswith("GoalRejected: ")
    assert twin.status is GoalStatus.UNKNOWN
    with pytest.raises(InvalidGraphName, match="32 lower-case hex digits"):
        client.send_goal("/fib", harness.goal(), diary.events, "goal-1")


async def test_a_displaced_server_is_restored_when_the_newer_one_has_gone(
    harness: Harness, server: Server, diary: GoalDiary
) -> None:
    client = harness.graph.participant("/c")
    client.send_goal("/fib", harness.goal(), diary.events)
    await harness.settle()
    newer = Server(harness, "/newer")
    await harness.settle()
    assert server.heard == ["Action /fib was unadvertised"]
    assert diary.heard[-1] == (GoalStatus.ABORTED, "ProviderGone: Action /fib was unadvertised")
    client.send_goal("/fib", harness.goal(), GoalEvents(lambda *_: None))
    await harness.settle()
    assert (len(server.goals), len(newer.goals)) == (1, 1)
    newer.participant.close()
    await harness.settle()
    info = harness.graph.action("/fib")
    assert info is not None and info.node == "/server"
    client.send_goal("/fib", harness.goal(), GoalEvents(lambda *_: None))
    await harness.settle()
    assert (len(server.goals), len(newer.goals)) == (2, 1)
    client.cancel_goal("/fib", server.goals[1].id)
    await harness.settle()
    assert server.heard[-1] == "cancel"
    server.registration.close()
    await harness.settle()
    assert harness.graph.action("/fib") is None
    assert [each.name for each in harness.graph.services() if each.name.startswith("/fib/")] == []


async def test_a_server_that_raises_rejects(
    harness: Harness, server: Server, diary: GoalDiary, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(_goal: ServerGoal) -> None:
        raise ZeroDivisionError

    server.on_goal = fail
    with caplog.at_level(logging.ERROR):
        harness.graph.participant("/c").send_goal("/fib", harness.goal(), diary.events)
        await harness.settle()
    assert diary.heard == [(GoalStatus.UNKNOWN, "GoalRejected: internal error")]


async def test_a_client_that_raises_is_logged(
    harness: Harness, server: Server, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError

    goal = harness.graph.participant("/c").send_goal("/fib", harness.goal(), GoalEvents(fail, fail, fail))
    await harness.settle()
    with caplog.at_level(logging.ERROR):
        server.goals[0].feedback(harness.sequence(part="feedback"))
        server.goals[0].finish(GoalStatus.SUCCEEDED, harness.sequence())
        await harness.settle()
    assert goal.status is GoalStatus.SUCCEEDED
    assert caplog.text.count("ZeroDivisionError") >= 2


@pytest.mark.parametrize("where", ["here", "elsewhere"])
async def test_the_robots_action_displaces_that_of_clients(harness: Harness, where: str) -> None:
    registry = harness.graph.registry
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    displaced: list[str] = []
    lost: list[object] = []

    def accept(goal: ServerGoal) -> None:
        goal.on_end = lost.append
        goal.accept()

    offer = clients.advertise_action("/a", registry.action(harness.fibonacci), accept)
    offer.on_displaced = displaced.append
    await harness.settle()
    diary = GoalDiary()
    harness.graph.participant("/caller").send_goal("/a", harness.goal(), diary.events)
    await harness.settle()
    robot = harness.elsewhere("/robot") if where == "elsewhere" else harness.graph.participant("/robot")
    reached: list[str] = []

    def finish(goal: ServerGoal) -> None:
        reached.append(goal.id)
        goal.accept()
        goal.finish(GoalStatus.SUCCEEDED, harness.sequence(7))

    robot.advertise_action("/a", registry.action(harness.fibonacci), finish)
    await harness.settle()
    assert len(displaced) == len(lost) == 1
    later = GoalDiary()
    harness.graph.participant("/caller").send_goal("/a", harness.goal(), later.events)
    await harness.settle()
    assert len(reached) == 1
    assert later.heard[-1] == (GoalStatus.SUCCEEDED, [7])


async def test_topics_of_an_action_that_clients_subscribe_to_do_not_keep_the_robot_from_offering_it(
    harness: Harness,
) -> None:
    registry = harness.graph.registry
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    for topic in ("feedback", "status", "result", "goal", "cancel"):
        for name in (f"/a/_action/{topic}", f"/a/{topic}"):
            clients.subscribe(name, lambda _: None, registry.message("std_msgs/Int32"))
    await harness.settle()
    robot = harness.graph.participant("/robot")
    robot.advertise_action("/a", registry.action(harness.fibonacci), lambda goal: goal.accept())
    await harness.settle()
    diary = GoalDiary()
    harness.graph.participant("/caller").send_goal("/a", harness.goal(), diary.events)
    await harness.settle()
    assert diary.heard[0] == "accepted"
