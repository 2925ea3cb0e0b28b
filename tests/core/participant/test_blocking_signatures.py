"""Blocking objects have the verbs of the asynchronous ones, with the same arguments; robots in tests, too."""

from __future__ import annotations

import inspect

import pytest

from rwt import BlockingNode
from rwt.extensions.testing import ScriptedRobot
from rwt_client.blocking import (
    BlockingApi,
    BlockingClientClock,
    BlockingClientPublisher,
    BlockingClientSubscription,
    BlockingRemoteTransforms,
    BlockingRobot,
)
from rwt_client.endpoints.publisher import RemotePublisher
from rwt_client.endpoints.remote_handle import RemoteHandle
from rwt_client.endpoints.subscriptions import RemoteSubscription
from rwt_client.endpoints.transforms import RemoteTransforms
from rwt_client.robot import Robot
from rwt_client.rosapi import RosApi
from rwt_graph import Node
from rwt_graph.clock import Clock
from rwt_graph.nodes.blocking import (
    BlockingClock,
    BlockingGraphNode,
    BlockingTopicPublisher,
    BlockingTopicSubscription,
)
from rwt_graph.nodes.endpoints import TopicPublisher, TopicSubscription
from rwt_participant.api import Parameters
from rwt_participant.blocking import (
    BlockingGoal,
    BlockingHandle,
    BlockingParameters,
    BlockingTimer,
    BlockingTransforms,
)
from rwt_participant.goals import Goal
from rwt_participant.handles import Handle
from rwt_participant.timers import PeriodicTimer, RobotClock
from rwt_participant.transforms import Transforms

PAIRS: dict[type, type] = {
    BlockingNode: Node,
    BlockingGraphNode: ScriptedRobot,
    BlockingTopicPublisher: TopicPublisher,
    BlockingTopicSubscription: TopicSubscription,
    BlockingHandle: Handle,
    BlockingGoal: Goal,
    BlockingClock: Clock,
    BlockingTransforms: Transforms,
    BlockingParameters: Parameters,
    BlockingTimer: PeriodicTimer,
    BlockingRobot: Robot,
    BlockingClientPublisher: RemotePublisher,
    BlockingClientSubscription: RemoteSubscription,
    BlockingClientClock: RobotClock,
    BlockingRemoteTransforms: RemoteTransforms,
    BlockingApi: RosApi,
}

CALLED_BY_THE_LOOP = {
    BlockingNode: {"graph", "run", "run_blocking"},
    BlockingGoal: {"end", "take_feedback"},
    BlockingClock: {"call_urgently", "drive", "playback", "within"},
    BlockingClientClock: {"within"},
    BlockingTimer: {"start"},
    BlockingTransforms: {"end", "send_static_again"},
    BlockingRemoteTransforms: {"end", "on_event", "send_static_again"},
    BlockingClientPublisher: {"checked", "message_refused", "error"},
    BlockingClientSubscription: {"deliver", "error"},
}
"""Public names that only the code of the event loop uses, or that exist in tasks only."""

OF_SESSIONS = {
    name for name in vars(RemoteHandle) if not name.startswith("_") and name not in ("ready", "close", "type")
} | {"refused"}


def public(kind: type) -> set[str]:
    return {name for name in dir(kind) if not name.startswith("_")}


def attributes(kind: type) -> set[str]:
    """Return the names of attributes that constructors set."""
    constructors = [vars(each)["__init__"] for each in kind.__mro__[:-1] if "__init__" in vars(each)]
    return {name for each in constructors for name in each.__code__.co_names}


def parameters(function: object) -> list[tuple[str, object, object]]:
    assert callable(function)
    return [(each.name, each.kind, each.default) for each in inspect.signature(function).parameters.values()]


@pytest.mark.parametrize("blocking", PAIRS, ids=lambda kind: kind.__name__)
def test_a_blocking_object_has_every_verb(blocking: type) -> None:
    wanted = public(PAIRS[blocking]) - CALLED_BY_THE_LOOP.get(blocking, set())
    if issubclass(PAIRS[blocking], RemoteHandle):
        wanted -= OF_SESSIONS
    if PAIRS[blocking] is ScriptedRobot:
        wanted = public(Node) - CALLED_BY_THE_LOOP[BlockingNode]
    assert wanted - public(blocking) - attributes(blocking) == set()


@pytest.mark.parametrize("blocking", PAIRS, ids=lambda kind: kind.__name__)
def test_its_verbs_have_the_same_arguments(blocking: type) -> None:
    other = PAIRS[blocking]
    for name in public(blocking) & public(other):
        verbs = getattr(other, name), getattr(blocking, name)
        if all(map(callable, verbs)):
            assert parameters(verbs[1])[1:] == parameters(verbs[0])[1:], name


def test_a_function_for_robots_also_gets_those_of_tests(rwt_robot: ScriptedRobot) -> None:
    def start(robot: ScriptedRobot | BlockingNode) -> str:
        robot.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"message": "beep"})
        robot.advertise("/speed", "std_msgs/Float64").publish({"data": 1.0})
        return str(robot.blocking.call("/beep").message)

    assert start(rwt_robot) == "beep"
