"""Rights that names alone do not show: displacing the robot's own, and the services behind an action."""

from __future__ import annotations

from collections.abc import Mapping

import anyio
import pytest

from rwt import Settings
from rwt.access.access import Access
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_graph.api import GoalEvents, ServerGoal
from rwt_interfaces.payload import Payload
from rwt_participant.goals import ReceivedGoal
from tests.core.rosbridge.recording_client import Client

FIBONACCI = "example_interfaces/Fibonacci"
ADVERTISE = (
    ("advertise_service", {"service": "/rosapi/get_time", "type": "rosapi_msgs/GetTime"}),
    ("advertise_service", {"service": "//rosapi/get_time/", "type": "std_srvs/Trigger"}),
    ("advertise_service", {"service": "fib/_action/cancel_goal", "type": "action_msgs/CancelGoal"}),
    ("advertise_action", {"action": "fib", "type": FIBONACCI}),
)


@pytest.fixture
def graph() -> MemoryGraph:
    """A robot with rosapi and an action."""
    graph = MemoryGraph(clock=SimulatedClock(1_700_000_000 * 10**9))
    Rosapi(graph)

    async def execute(goal: ReceivedGoal) -> None:
        await anyio.sleep_forever()

    Node(graph, "robot").advertise_action("/fib", FIBONACCI, execute)
    return graph


def _bridge(graph: MemoryGraph, globs: Mapping[str, object]) -> Bridge:
    settings = Settings.model_validate({"auth": {"default_role": "guest"}, "roles": {"guest": globs}})
    return Bridge(graph, settings, Access(graph, settings, DISCLOSURES))


def _ask(client: Client, op: str, members: Mapping[str, object]) -> str:
    client.say("set_level", level="error")
    client.say(op, id="q", **members)
    return str(client.heard())


# -- displacing --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("op", "members"), ADVERTISE)
def test_the_robots_own_provider_is_displaced_by_right_only(
    graph: MemoryGraph, op: str, members: Mapping[str, object]
) -> None:
    before = (graph.services(), graph.actions())
    refused = _ask(Client(_bridge(graph, {"provide": ["*"]})), op, members)
    assert "(roles.guest.displace)" in refused
    assert (graph.services(), graph.actions()) == before
    allowed = Client(_bridge(graph, {"provide": ["*"], "displace": ["/rosapi/*", "/fib*"]}))
    assert _ask(allowed, op, members) == "[]"
    assert (graph.services(), graph.actions()) != before
    allowed.leave()
    assert (graph.services(), graph.actions()) == before


@pytest.mark.parametrize(("op", "members"), ADVERTISE)
def test_without_roles_the_robots_own_comes_back_when_the_client_leaves(
    graph: MemoryGraph, op: str, members: Mapping[str, object]
) -> None:
    before = (graph.services(), graph.actions())
    client = Client(Bridge(graph, Settings()))
    assert _ask(client, op, members) == "[]"
    client.leave()
    assert (graph.services(), graph.actions()) == before


def test_what_is_not_the_robots_own_needs_no_right_to_displace(graph: MemoryGraph) -> None:
    bridge = _bridge(graph, {"provide": ["*"]})
    for client in (Client(bridge), Client(bridge)):
        for op, members in (
            ("advertise_service", {"service": "/own", "type": "std_srvs/Trigger"}),
            ("advertise_service", {"service": "/rosapi/more", "type": "std_srvs/Trigger"}),
            ("advertise_action", {"action": "/go", "type": FIBONACCI}),
        ):
            assert _ask(client, op, members) == "[]"


# -- behind an action --------------------------------------------------------------------------------------

CANCEL = {"service": "/fib/_action/cancel_goal", "args": {}}


@pytest.mark.parametrize("spelling", ["/fib/_action/cancel_goal", "fib//_action/cancel_goal/"])
def test_an_actions_services_need_the_right_to_its_goals(graph: MemoryGraph, spelling: str) -> None:
    cancelled: list[bool] = []
    kind = graph.registry.action(FIBONACCI)

    def on_goal(goal: ServerGoal) -> None:
        goal.on_cancel = lambda: cancelled.append(True)
        goal.accept()

    graph.participant("/other").advertise_action("/fib", kind, on_goal)
    graph.participant("/sender").send_goal(
        "/fib", Payload.from_value(kind.goal, {}), GoalEvents(lambda *_: None)
    )
    call = {"service": spelling, "args": {}}
    refused = _ask(Client(_bridge(graph, {"call": ["*"], "goals": ["/other"]})), "call_service", call)
    assert "(roles.guest.goals)" in refused
    assert cancelled == []
    allowed = _ask(Client(_bridge(graph, {"goals": ["/fib"]})), "call_service", call)
    assert "'result': True" in allowed
    assert cancelled == [True]


@pytest.mark.parametrize(
    ("globs", "refused"),
    [
        ({"goals": ["/fib"]}, False),
        ({"subscribe": ["/fib/*"]}, False),
        ({"goals": ["/other"]}, True),
        ({"call": ["*"], "publish": ["*"]}, True),
    ],
)
@pytest.mark.parametrize("part", ["feedback", "status"])
def test_an_actions_topics_are_open_to_those_who_send_it_goals(
    graph: MemoryGraph, part: str, globs: Mapping[str, object], refused: bool
) -> None:
    topic = {"topic": f"/fib/_action/{part}", "type": "std_msgs/String"}
    assert ("roles.guest" in _ask(Client(_bridge(graph, globs)), "subscribe", topic)) is refused


@pytest.mark.parametrize("name", ["/fib/_action/feedback/deeper", "/fib/_action/other", "/_action/feedback"])
def test_other_names_with_an_action_in_them_are_topics_like_any(graph: MemoryGraph, name: str) -> None:
    topic = {"topic": name, "type": "std_msgs/String"}
    assert "(roles.guest.subscribe)" in _ask(Client(_bridge(graph, {"goals": ["*"]})), "subscribe", topic)


def test_an_actions_services_are_listed_to_those_who_may_use_them(graph: MemoryGraph) -> None:
    hidden = "/fib/_action/cancel_goal"
    for globs, shown in (({"goals": ["/fib"]}, True), ({"call": ["*"]}, False), ({"provide": ["*"]}, True)):
        client = Client(_bridge(graph, globs))
        client.say("call_service", service="/rosapi/service_type", args={"service": hidden})
        assert bool(client.heard()[0]["values"]["type"]) is shown, globs
