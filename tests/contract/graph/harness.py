"""Entrance of the contract tests for graphs: a harness is all that they know of a backend.

Every backend of this project has one, in `BACKENDS` of :mod:`tests.contract.graph.conftest`. To run the tests
on another backend, derive a :class:`Harness` for it, and name it::

    python -m pytest tests/contract/graph --graph-backend my_backend.contract:MyHarness

A backend that links processes is tested as a :class:`~tests.contract.graph.paired.PairedGraph`: providers in
one graph, consumers in the other. :mod:`tests.contract.graph.queue_backend` is a whole example, which imports
nothing but public modules of the project.

Tests of what a backend declares that it cannot do (`limitations`) must fail.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Final

from rwt_graph.api import GoalEvents, Graph, Limitation, Participant
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, ProviderGone
from rwt_participant.goals import GoalStatus
from rwt_participant.messages import Message
from tests.contract.graph.paired import PairedGraph

if TYPE_CHECKING:
    import pytest


#: Name by which other processes know a node for clients.
CLIENTS: Final = "/rosbridge_websocket"


class Harness(ABC):
    """Graph of one backend, and the messages that the tests send through it.

    The constructor takes nothing; the tests enter the graph. Its clock is :attr:`clock`, at one second.

    Attributes:
        fibonacci: type of the actions.
        differences: reasons of further tests that fail, by name.
    """

    graph: Graph
    clock: SimulatedClock
    fibonacci = "example_interfaces/Fibonacci"
    differences: ClassVar[Mapping[str, str]] = {}

    def __init__(self) -> None:
        self.clock = SimulatedClock(start_ns=1_000_000_000)

    def patch(self, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: B027 - optional
        """Change what :meth:`settle` needs to be changed; called before the graph is entered."""

    @abstractmethod
    async def settle(self) -> None:
        """Return when everything that was sent has arrived."""

    async def advance(self, seconds: float) -> None:
        """Let time go by, then settle."""
        self.clock.advance(seconds)
        await self.settle()

    def elsewhere(self, node: str) -> Participant:
        """Return a node of another process than that of the providers; of this one if there is no other."""
        graph = self.graph.consumer if isinstance(self.graph, PairedGraph) else self.graph
        return graph.participant(node)

    def message(self, name: str, value: object) -> Payload:
        return Payload.from_value(self.graph.registry.message(name), value)

    def text(self, data: str) -> Payload:
        """A `std_msgs/String`."""
        return self.message("std_msgs/String", {"data": data})

    def request(self) -> Payload:
        return Payload.from_value(self.graph.registry.service("std_srvs/Trigger").request, {})

    def response(self, message: str = "", success: bool = True) -> Payload:
        response = self.graph.registry.service("std_srvs/Trigger").response
        return Payload.from_value(response, {"success": success, "message": message})

    def goal(self, order: int = 1) -> Payload:
        return Payload.from_value(self.graph.registry.action(self.fibonacci).goal, {"order": order})

    def sequence(self, *numbers: int, part: str = "result") -> Payload:
        interface = self.graph.registry.action(self.fibonacci)
        kind = interface.result if part == "result" else interface.feedback
        return Payload.from_value(kind, {"sequence": list(numbers)})


class GoalDiary:
    """Writes down what the client of a goal hears: `accepted`, numbers, and status with numbers or error."""

    def __init__(self) -> None:
        self.heard: list[Any] = []

    @property
    def events(self) -> GoalEvents:
        return GoalEvents(self._result, self._feedback, lambda: self.heard.append("accepted"))

    def _feedback(self, feedback: Payload) -> None:
        self.heard.append(_numbers(feedback))

    def _result(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        if isinstance(outcome, CallFailed):
            self.heard.append((status, failure_text(outcome)))
        else:
            self.heard.append((status, _numbers(outcome)))


def failure_text(failure: CallFailed) -> str:
    """Return class and text of a failure, without the node that left: not every backend knows it."""
    text = str(failure)
    if isinstance(failure, ProviderGone) and failure.node:
        text = text.removesuffix(f": its node {failure.node} left")
    return f"{type(failure).__name__}: {text}"


def _numbers(payload: Payload) -> list[int]:
    message: Message = payload.value()
    return list(message.sequence)


#: Tests that fail with a limitation, by name and parameter `how`.
LIMITED: Final = {
    "test_answers_come_in_any_order": Limitation.SERVICE_ERRORS,
    "test_a_provider_that_raises_fails_the_call_without_telling_why": Limitation.SERVICE_ERRORS,
    "test_a_timeout_is_never_early_and_at_most_20_ms_late": Limitation.CALL_END,
    "test_both_sides_learn_once_that_a_call_has_ended[fail]": Limitation.SERVICE_ERRORS,
    "test_both_sides_learn_once_that_a_call_has_ended[timeout]": Limitation.CALL_END,
    "test_both_sides_learn_once_that_a_call_has_ended[cancel]": Limitation.CALL_END,
    "test_both_sides_learn_once_that_a_call_has_ended[caller leaves]": Limitation.CALL_END,
    "test_kept_samples_are_forgotten_after_their_lifespan": Limitation.LIFESPAN,
    "test_subscriber_count_and_endpoints": Limitation.SUBSCRIBER_COUNT,
}

#: Tests that may fail with :attr:`Limitation.GOAL_REASONS`.
UNSTABLE: Final = frozenset(("test_a_rejected_goal", "test_a_server_that_raises_rejects"))


def load(name: str) -> type[Harness]:
    """Return the harness that `module:Class` names."""
    module, _, attribute = name.partition(":")
    found: type[Harness] = getattr(import_module(module), attribute)
    return found
