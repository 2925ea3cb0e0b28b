"""An action server's services and topics of ROS 2, asked in the same process; no network takes part."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.extensions.zenoh import ZenohGraph
from rwt_graph import SimulatedClock
from rwt_graph.actions.server import RESULTS_KEPT
from rwt_graph.api import GoalEvents, ServerGoal
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.goals import GoalStatus
from rwt_participant.messages import Message


class Asker:
    """Calls an action's services as a client of ROS 2 does."""

    def __init__(self) -> None:
        self.clock = SimulatedClock(start_ns=5_000_000_007)
        self.graph = ZenohGraph(Registry(), self.clock)
        self.goals: list[ServerGoal] = []
        self.orders: list[int] = []
        self.type = self.graph.registry.action("example_interfaces/Fibonacci")
        self.server = self.graph.participant("/p").advertise_action("/fib", self.type, self._taken)
        self.client = self.graph.participant("/c")
        self.answers: list[Any] = []

    def _taken(self, goal: ServerGoal) -> None:
        message: Message = goal.goal.value()
        self.orders.append(message.order)
        self.goals.append(goal)

    def ask(self, service: str, request: object) -> None:
        info = self.graph.service(f"/fib/_action/{service}")
        assert info is not None
        payload = Payload.from_value(info.type.request, request)
        self.client.call_service(info.name, payload, self._answered)

    def _answered(self, answer: Any) -> None:
        self.answers.append(answer.value() if isinstance(answer, Payload) else answer)

    def send(self, number: int) -> None:
        self.ask("send_goal", {"goal_id": {"uuid": bytes([number] * 16)}, "goal": {"order": number}})

    def ask_result(self, number: int) -> None:
        self.ask("get_result", {"goal_id": {"uuid": bytes([number] * 16)}})

    def finish(self, goal: ServerGoal, *sequence: int) -> None:
        goal.finish(GoalStatus.SUCCEEDED, Payload.from_value(self.type.result, {"sequence": list(sequence)}))

    def listen(self, topic: str) -> list[Message]:
        heard: list[Message] = []
        self.client.subscribe(f"/fib/_action/{topic}", lambda sample: heard.append(sample.payload.value()))
        return heard


@pytest.fixture
def asker() -> Asker:
    return Asker()


def test_a_goal_is_accepted_with_the_time_and_its_result_waited_for(asker: Asker) -> None:
    asker.send(3)
    assert asker.answers == []
    goal = asker.goals[0]
    assert (goal.id, asker.orders) == ("03" * 16, [3])
    goal.accept()
    (accepted,) = asker.answers
    assert (accepted.accepted, accepted.stamp.sec, accepted.stamp.nanosec) == (True, 5, 7)
    asker.ask_result(3)
    assert len(asker.answers) == 1
    asker.finish(goal, 0, 1)
    assert (asker.answers[1].status, asker.answers[1].result.sequence) == (4, [0, 1])
    # Who asks later is told the same.
    asker.ask_result(3)
    assert asker.answers[2] == asker.answers[1]


def test_the_result_of_a_goal_that_nobody_knows(asker: Asker) -> None:
    asker.ask_result(9)
    assert [(answer.status, answer.result.sequence) for answer in asker.answers] == [(0, [])]


def test_as_many_results_are_kept_and_no_more(asker: Asker) -> None:
    for number in range(1, RESULTS_KEPT + 2):
        asker.send(number)
        asker.goals[-1].accept()
        asker.finish(asker.goals[-1], number)
    asker.answers.clear()
    for number in (1, 2, RESULTS_KEPT + 1):
        asker.ask_result(number)
    assert [answer.status for answer in asker.answers] == [0, 4, 4]


def test_states_and_feedback_of_every_goal_are_published(asker: Asker) -> None:
    states, feedbacks = asker.listen("status"), asker.listen("feedback")
    goal = Payload.from_value(asker.type.goal, {"order": 1})
    asker.client.send_goal("/fib", goal, GoalEvents(lambda *_: None), "ab" * 16)
    asker.goals[0].accept()
    asker.goals[0].feedback(Payload.from_value(asker.type.feedback, {"sequence": [1]}))
    asker.finish(asker.goals[0])
    asker.goals[0].feedback(Payload.from_value(asker.type.feedback, {"sequence": [2]}))
    assert [[status.status for status in message.status_list] for message in states] == [[1], [2], [4]]
    assert {bytes(m.status_list[0].goal_info.goal_id.uuid) for m in states} == {b"\xab" * 16}
    (feedback,) = feedbacks
    assert (bytes(feedback.goal_id.uuid), feedback.feedback.sequence) == (b"\xab" * 16, [1])


def test_a_question_for_a_result_that_is_withdrawn_is_forgotten(asker: Asker) -> None:
    asker.send(1)
    asker.goals[0].accept()
    info = asker.graph.service("/fib/_action/get_result")
    assert info is not None
    request = Payload.from_value(info.type.request, {"goal_id": {"uuid": bytes([1] * 16)}})
    answers: list[object] = []
    pending = [asker.client.call_service(info.name, request, answers.append) for _ in range(3)]
    pending[1].cancel()
    asker.finish(asker.goals[0], 7)
    assert len(answers) == 2
