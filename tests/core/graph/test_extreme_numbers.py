"""Whatever number a verb is given, it completes, or it is refused and the graph is as before."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt_graph.api import GoalEvents, PendingCall, ServerGoal, ServiceCall
from rwt_graph.clock import SimulatedClock, SteadyClock
from rwt_graph.errors import InvalidGraphName
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.nodes.node import Node
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.errors import CallTimeout, InvalidQoS, RobotError
from rwt_participant.qos import LONGEST_SECONDS, MOST_DEPTH, Durability, History, QoS

EDGES = (0, 1, 2**31, 2**32, 2**53, 2**63, 2**64, 10**30, 10**400)

wholes = st.sampled_from([*EDGES, *(-edge for edge in EDGES)]) | st.integers()
reals = st.floats() | wholes | st.sampled_from([1e308, -1e308, 5e-324, math.inf, -math.inf, math.nan])
REGISTRY = Registry()

Undo = Callable[[], object]


def _ignore(*_: object) -> None:
    """A callback that is of no matter."""


class Robot:
    """A graph with one service that never answers and one topic without a type."""

    def __init__(self) -> None:
        self.clock = SimulatedClock(1_700_000_000 * 10**9)
        self.graph = MemoryGraph(REGISTRY, self.clock)
        self.node = Node(self.graph, "robot")
        self.participant = self.graph.participant("/parts")
        self.trigger = self.graph.registry.service("std_srvs/Trigger")
        self.participant.advertise_service("/slow", self.trigger, _ignore)
        self.participant.subscribe("/untyped", _ignore)

    def ask(self, service: str, on_reply: Callable[[object], None], seconds: Any) -> PendingCall:
        """Call a service."""
        request = Payload.from_value(self.trigger.request, {})
        return self.participant.call_service(service, request, on_reply, seconds)

    def endpoints(self) -> tuple[object, ...]:
        """All that the graph lists."""
        return (self.graph.topics(), self.graph.services(), self.graph.actions(), self.graph.nodes())


def _qos_of(draw: Any) -> QoS:
    return QoS(
        draw(st.sampled_from(History)),
        draw(wholes),
        durability=draw(st.sampled_from(Durability)),
        deadline=draw(st.none() | reals),
        lifespan=draw(st.none() | reals),
    )


def _advertise(draw: Any, robot: Robot) -> Undo:
    message = robot.graph.registry.message("std_msgs/Int32")
    topic = draw(st.sampled_from(["/new", "/untyped"]))
    publisher = robot.participant.advertise(topic, message, _qos_of(draw))
    publisher.publish(Payload.from_value(message, {"data": 1}))
    return publisher.close


def _subscribe(draw: Any, robot: Robot) -> Undo:
    type = draw(st.sampled_from([None, "std_msgs/Int32", "std_msgs/String"]))
    message = None if type is None else robot.graph.registry.message(type)
    topic = draw(st.sampled_from(["/new", "/untyped"]))
    subscription = robot.participant.subscribe(topic, _ignore, message, _qos_of(draw))
    subscription.history()
    return subscription.close


def _call(draw: Any, robot: Robot) -> Undo:
    answers: list[object] = []
    call = robot.ask("/slow", answers.append, draw(st.none() | reals))
    assert answers == []
    return call.cancel


def _timer(draw: Any, robot: Robot) -> Undo:
    return robot.node.create_timer(draw(reals), _ignore).cancel


def _later(draw: Any, robot: Robot) -> Undo:
    return robot.clock.call_later(draw(reals), _ignore).cancel


def _move(draw: Any, robot: Robot) -> Undo:
    if draw(st.booleans()):
        robot.clock.set_time(draw(wholes))
    else:
        robot.clock.advance(draw(reals))
    return _ignore


VERBS = (_advertise, _subscribe, _call, _timer, _later, _move)


@pytest.mark.slow
@settings(max_examples=500)
@given(st.data())
def test_a_verb_with_extreme_numbers_completes_or_leaves_nothing(data: st.DataObject) -> None:
    robot = Robot()
    before = robot.endpoints()
    for _ in range(3):
        undo: Undo = _ignore
        try:
            undo = data.draw(st.sampled_from(VERBS))(data.draw, robot)
        except (RobotError, ValueError) as refused:
            assert str(refused)
        undo()
        assert robot.endpoints() == before
    # One timer serves all deadlines, and outlives the call that it was made for.
    assert robot.clock.pending() <= 1
    robot.clock.advance(1.0)


@pytest.mark.parametrize("seconds", [1e308, 10**400, math.inf])
def test_a_call_that_may_wait_for_ages_is_answered_once(seconds: float) -> None:
    robot = Robot()
    calls: list[ServiceCall] = []
    answers: list[object] = []
    robot.participant.advertise_service("/ask", robot.trigger, calls.append)
    robot.ask("/ask", answers.append, seconds)
    robot.clock.advance(1e6)
    assert answers == []
    for _ in range(2):
        calls[0].reply(Payload.from_value(robot.trigger.response, {}))
    assert len(answers) == 1


def test_a_timeout_that_is_no_number_or_negative_is_over_at_once() -> None:
    robot = Robot()
    for seconds in (math.nan, -math.inf, -(10**400)):
        answers: list[object] = []
        robot.ask("/slow", answers.append, seconds)
        robot.clock.advance(0.1)
        assert isinstance(answers[0], CallTimeout), seconds


@pytest.mark.parametrize(
    ("policies", "expected"),
    [
        ({"depth": 10**30}, rf"depth .* 0 to {MOST_DEPTH} samples, not a very large number"),
        ({"depth": -1}, "depth .* not -1"),
        ({"depth": 10**5000}, "depth .* not a very large number"),
        ({"lifespan": 1e308}, rf"lifespan .* 0 to {LONGEST_SECONDS} seconds, not a very large number"),
        ({"lifespan": 10**5000}, "lifespan .* not a very large number"),
        ({"deadline": math.nan}, "deadline .* not nan"),
        ({"deadline": -1.0}, "deadline .* not -1"),
    ],
)
def test_a_policy_out_of_its_range_is_refused_by_name(policies: dict[str, Any], expected: str) -> None:
    with pytest.raises(InvalidQoS, match=expected):
        QoS(**policies)


def test_a_steady_clock_bounds_delays_too() -> None:
    clock = SteadyClock()
    for seconds in (1e308, 10**400, math.inf, math.nan, -math.inf):
        clock.call_later(seconds, _ignore).cancel()


def test_an_action_whose_services_have_no_name_is_not_offered_at_all() -> None:
    robot = Robot()
    before = robot.endpoints()
    kind = robot.graph.registry.action("example_interfaces/Fibonacci")
    with pytest.raises(InvalidGraphName, match="longer than"):
        robot.participant.advertise_action("/" + "a" * 500, kind, _ignore)
    assert robot.endpoints() == before


def test_a_goal_of_an_extreme_id_is_refused() -> None:
    robot = Robot()
    goals: list[ServerGoal] = []
    kind = robot.graph.registry.action("example_interfaces/Fibonacci")
    robot.participant.advertise_action("/go", kind, goals.append)
    goal = Payload.from_value(kind.goal, {"order": 1})
    for wrong in ("", "0" * 10**6, "0" * 31 + "g"):
        with pytest.raises(InvalidGraphName, match="goal id"):
            robot.participant.send_goal("/go", goal, GoalEvents(_ignore), wrong)
    assert goals == []
