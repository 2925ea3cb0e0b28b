"""Access to the graph only by a rule: checks every verb, service, route and name."""

from __future__ import annotations

import inspect
import json
import math
import re
import struct
from collections.abc import AsyncIterator, Iterator, Mapping
from pathlib import Path
from typing import Any

import anyio.lowlevel
import msgspec
import pytest

import rwt
import rwt_webrtc
from rwt import Settings
from rwt.access import decisions
from rwt.access.access import Access
from rwt.access.client_graph import ClientGraph
from rwt.access.errors import GateRefused, NotAllowed
from rwt.access.graph_view import GraphView
from rwt.access.settings import GateRule
from rwt.composition.pages import routes
from rwt.delivery.shared_graph import SharedGraph
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.extensions.video import WebVideoServer
from rwt.observability.metrics import ServerMetrics
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph, Node
from rwt_graph.api import GoalEvents, Graph
from rwt_graph.clock import SimulatedClock
from rwt_graph.nodes.logs import DISCLOSURES as LOGGERS
from rwt_graph.parameters.services import DISCLOSURES as PARAMETER_DISCLOSURES
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse
from tests.core.rosbridge.recording_client import Client
from tests.extensions.foxglove.viewer import Viewer

#: A guest may do everything with what is called so, and nothing with anything else.
GUEST = {
    act: ["*open*"] for act in ("publish", "subscribe", "call", "provide", "goals", "get_param", "set_param")
}
HIDDEN = "secret"
#: As long as the hidden one, and nowhere in the graph.
ABSENT = "nought"


def _access(graph: Graph, globs: Mapping[str, object], **further: object) -> Access:
    return Access(graph, _settings(globs, **further), DISCLOSURES)


def _settings(globs: Mapping[str, object], **further: object) -> Settings:
    return Settings.model_validate({"auth": {"default_role": "guest"}, "roles": {"guest": globs}, **further})


def _bridge(graph: Graph, settings: Settings) -> Bridge:
    return Bridge(graph, settings, Access(graph, settings, DISCLOSURES))


@pytest.fixture
async def graph(distro: str) -> AsyncIterator[MemoryGraph]:
    """A robot of which each kind of thing is there twice: once open, and once hidden on a node of its own."""
    graph = MemoryGraph(Registry(DISTROS[distro]), SimulatedClock(1_700_000_000_000_000_000))

    async def execute(goal: object) -> None:
        await anyio.sleep_forever()

    async with graph:
        with Rosapi(graph):
            for name in ("open", HIDDEN):
                node = Node(graph, f"{name}_node")
                node.advertise(f"/{name}_topic", "sensor_msgs/Image")
                node.subscribe(f"/{name}_heard", lambda message: None, type="std_msgs/String")
                node.advertise_service(f"/{name}_service", "std_srvs/Trigger", lambda _: {"success": True})
                node.advertise_action(f"/{name}_action", "example_interfaces/Fibonacci", execute)
                node.parameters.declare(f"{name}_param", 1.0)
                if name == "open":  # A visible node has a hidden service.
                    node.advertise_service(f"/{HIDDEN}_door", "std_srvs/Empty", lambda _: {})
            # A node that is shown offers something that is hidden, too.
            Node(graph, "open_node").advertise_service(f"/{HIDDEN}_shared", "std_srvs/SetBool", lambda _: {})
            yield graph


# -- verbs -------------------------------------------------------------------------------------------------


def _nothing(*_: object) -> None:
    """A callback that is never called."""


def _empty(type: Any) -> Payload:
    raise AssertionError("a verb that is refused makes no payload")


VERBS: Mapping[str, tuple[Any, ...]] = {
    "advertise": ("/x", "std_msgs/String", None),
    "publisher": ("/x", "std_msgs/String"),
    "subscribe": ("/x", "std_msgs/String"),
    "call_service": ("/x", _empty, _nothing),
    "advertise_service": ("/x", "std_srvs/Trigger", _nothing),
    "send_goal": ("/x", _empty, GoalEvents(on_result=_nothing)),
    "cancel_goal": ("/x", "0" * 32),
    "advertise_action": ("/x", "example_interfaces/Fibonacci", _nothing),
    "require": ("publish", "/x"),
}
"""Requests that access the graph: rejected for a role without rights."""

LISTINGS = {"topics", "services", "actions", "nodes"}
LOOK_UPS = {
    "topic", "service", "action", "may_call", "may_subscribe", "sees_node", "sees_service", "lease_seconds",
    "problems",
}  # fmt: skip
COUNTS = {"hidden"}
"""Numbers of names, which are not revealed."""
OWN = {
    "while_allowed", "unadvertise", "unsubscribe", "startup_samples", "withdraw_service", "withdraw_action",
    "take_role", "withdraw_refused", "keep", "late_sends", "leave", "close", "tell_notices", "tell_ended",
    "notices", "approval_of", "advertises", "join_compact", "leave_compact", "why_not_subscribe",
}  # fmt: skip
"""Requests that concern only what the client itself holds."""


def _client(graph: Graph, globs: Mapping[str, object], name: str = "", **further: object) -> ClientGraph:
    access = _access(graph, globs, **further)
    shared = SharedGraph(graph, "/gateway", 0.0, _nothing)
    return access.client(shared, access.admission.roles["guest"], "", name)


@pytest.mark.anyio
async def test_every_method_is_a_verb_with_a_rule_or_concerns_the_clients_own(graph: MemoryGraph) -> None:
    public = {
        name
        for kind in (GraphView, ClientGraph)
        for name, value in vars(kind).items()
        if inspect.isfunction(value) and not name.startswith("_")
    }
    assert public == set(VERBS) | LISTINGS | LOOK_UPS | COUNTS | OWN
    assert set(decisions.VERBS) == set(VERBS) - {"require"}


@pytest.mark.anyio
@pytest.mark.parametrize("gateway", [*decisions.gateways(), "undeclared"])
@pytest.mark.parametrize("verb", decisions.VERBS)
async def test_a_gateway_has_the_verbs_of_its_row_and_no_others(
    graph: MemoryGraph, gateway: str, verb: str
) -> None:
    client = _client(graph, {}, f"{gateway}:1")
    is_declared = gateway != "undeclared" and verb in decisions.decisions_of(f"{gateway}:1")
    text = rf"roles\.guest\.{decisions.VERBS[verb]}" if is_declared else f"{verb} is not declared"
    with pytest.raises(NotAllowed, match=text):
        getattr(client, verb)(*VERBS[verb])


def test_a_gateway_declares_the_verbs_that_it_uses() -> None:
    root = Path(rwt.__file__).parent
    folders = {"rosbridge": root / "rosbridge", "whip": Path(rwt_webrtc.__file__).parent / "media"}
    for gateway in decisions.gateways():
        folder = folders.get(gateway, root / "extensions" / gateway)
        text = "".join(file.read_text() for file in folder.rglob("*.py"))
        used = {verb for verb in decisions.VERBS if re.search(rf"(?:client|graph)\.{verb}\(", text)}
        # The agents' view of the robot has all verbs, and no tool uses these.
        used -= {"advertise_service", "advertise_action"} if gateway == "mcp" else set()
        assert used == set(decisions.decisions_of(gateway)), gateway


def test_a_gateway_of_an_extension_declares_its_verbs_once() -> None:
    decisions.declare("shouts", "publisher")
    decisions.declare("shouts", "publisher")
    assert set(decisions.decisions_of("shouts:1")) == {"publisher"}
    for verbs in (("publisher", "subscribe"), ("nought",)):
        with pytest.raises(ValueError, match="shouts"):
            decisions.declare("shouts", *verbs)


@pytest.mark.anyio
@pytest.mark.parametrize("verb", VERBS)
async def test_a_role_without_rights_can_do_nothing(graph: MemoryGraph, verb: str) -> None:
    before = [graph.topics(), graph.services(), graph.actions()]
    client = _client(graph, {})
    with pytest.raises(NotAllowed, match=r"roles\.guest\."):
        getattr(client, verb)(*VERBS[verb])
    assert [graph.topics(), graph.services(), graph.actions()] == before
    assert client.calls_in_flight == 0


@pytest.mark.anyio
async def test_a_role_without_rights_sees_nothing(graph: MemoryGraph) -> None:
    client = _client(graph, {})
    assert [getattr(client, name)() for name in sorted(LISTINGS - {"services", "nodes"})] == [(), ()]
    # rosapi itself is open to every role, by its declarations.
    assert {info.name.split("/")[1] for info in client.services()} == {"rosapi"}
    assert {info.name for info in client.nodes()} == {"/rosapi"}
    for name in sorted(LOOK_UPS):
        assert not getattr(client, name)("/open_topic")


# -- the gate ----------------------------------------------------------------------------------------------

ACTS: Mapping[str, tuple[str, str, str, str]] = {
    "publisher": ("topics", "/open_point", "geometry_msgs/Point", "x"),
    "call_service": ("services", "/open_spawn", "turtlesim/Spawn", "x"),
    "send_goal": ("actions", "/open_go", "nav2_msgs/NavigateToPose", "pose.pose.position.x"),
}
"""The verbs by which something is done to the robot: the key of a rule that names what it is done with, such
a name, its type, and a number in it."""

NOT_GATED: Mapping[str, str] = {
    "advertise": "says what will be published, which is looked at then",
    "subscribe": "reads",
    "advertise_service": "offers; what is the robot's own needs `displace`",
    "advertise_action": "offers; what is the robot's own needs `displace`",
    "cancel_goal": "stops",
    "require": "asks",
}

RULE_KINDS: Mapping[str, object] = {
    "lease": {"take": "service"},
    "fields": {"max": 1},
    "finite": True,
    "largest_bytes": 1,
    "messages_per_second": 1,
    "approval": {"roles": ["admin"]},
    "emergency": True,
}
"""Of every kind of rule one that lets nothing through, or of messages a single one."""

ABOUT_NAMES = {"topics", "services", "actions", "parameters", "roles", "stop", "type", "largest_items"}
"""Keys of a rule that select roles and names."""

OF_TOPICS = {"lease", "messages_per_second"}


def test_every_kind_of_rule_and_every_verb_is_walked_over() -> None:
    assert set(RULE_KINDS) == set(GateRule.model_fields) - ABOUT_NAMES
    assert set(ACTS) | set(NOT_GATED) == set(VERBS)


APPROVER = {"default_role": "guest", "tokens": {"person": {"token": "a-token-of-a-person", "role": "admin"}}}


def _gated(graph: Graph, verb: str, kind: str, mode: str) -> ClientGraph:
    names, name, _, field = ACTS[verb]
    value = {field: RULE_KINDS[kind]} if kind == "fields" else RULE_KINDS[kind]
    rule = {names: [name], kind: value, **({"stop": {}} if names == "topics" else {})}
    gate = {"mode": mode, "rules": {"it": rule}, "emergency": {"at_start": kind == "emergency"}}
    return _client(graph, GUEST, gate=gate, auth=APPROVER if kind == "approval" else {})


def _message(verb: str, kind: str) -> dict[str, object]:
    """A message, a request or a goal beyond what the kind of rule allows."""
    message: object = math.nan if kind == "finite" else 2.0
    for part in reversed(ACTS[verb][3].split(".")):
        message = {part: message}
    assert isinstance(message, dict)
    return message


def _act(client: ClientGraph, verb: str, kind: str) -> list[object]:
    """Do what a rule may forbid, four times; returns the outcomes of calls and goals."""
    _, name, type_name, _ = ACTS[verb]
    outcomes: list[object] = []
    for _ in range(4):
        if verb == "publisher":
            publisher = client.publisher(name, type_name)
            publisher.publish(Payload.from_value(publisher.type, _message(verb, kind)))
        elif verb == "call_service":
            client.call_service(
                name, lambda type: Payload.from_value(type, _message(verb, kind)), outcomes.append
            )
        else:
            client.send_goal(
                name,
                lambda type: Payload.from_value(type.goal, _message(verb, kind)),
                GoalEvents(on_result=lambda _, outcome: outcomes.append(outcome)),
            )
    return outcomes


def _ears(graph: MemoryGraph) -> list[object]:
    """Return the effects of :data:`ACTS` on the robot."""
    heard: list[object] = []
    robot = graph.participant("/ears")
    robot.subscribe("/open_point", heard.append, graph.registry.message("geometry_msgs/Point"))
    robot.advertise_service("/open_spawn", graph.registry.service("turtlesim/Spawn"), heard.append)
    robot.advertise_action("/open_go", graph.registry.action("nav2_msgs/NavigateToPose"), heard.append)
    return heard


CASES = [(kind, verb) for kind in RULE_KINDS for verb in ACTS if verb == "publisher" or kind not in OF_TOPICS]


@pytest.mark.anyio
@pytest.mark.parametrize("mode", ["enforce", "observe"])
@pytest.mark.parametrize(("kind", "verb"), CASES)
async def test_what_a_rule_of_any_kind_forbids_does_not_reach_the_graph(
    graph: MemoryGraph, kind: str, verb: str, mode: str
) -> None:
    heard = _ears(graph)
    client = _gated(graph, verb, kind, mode)
    heard.clear()
    if mode == "observe":
        _act(client, verb, kind)
        assert len(heard) == 4
        return
    if kind == "approval" and verb != "publisher":
        assert _act(client, verb, kind) == []  # They wait.
    else:
        with pytest.raises(GateRefused, match=r"gate\.rules\.it"):
            _act(client, verb, kind)
    assert len(heard) == (1 if kind == "messages_per_second" else 0)


@pytest.mark.anyio
async def test_who_may_not_publish_on_a_topic_is_not_told_how_it_is_leased(graph: MemoryGraph) -> None:
    rules = {"it": {"topics": ["/*_topic"], "lease": {"seconds": 2.5}, "stop": {}}}
    client = _client(graph, GUEST, gate={"rules": rules})
    assert [client.lease_seconds(name) for name in ("/open_topic", "open_topic", "//open_topic")] == [2.5] * 3
    for name in (f"/{HIDDEN}_topic", f"{HIDDEN}_topic", f"//{HIDDEN}_topic", f"/{ABSENT}_topic", "", "/ /"):
        assert client.lease_seconds(name) is None, name


# -- services ----------------------------------------------------------------------------------------------


class Asker:
    """A guest that calls services."""

    def __init__(self, graph: Graph) -> None:
        self._client = Client(_bridge(graph, _settings(GUEST)))

    async def ask(self, service: str, args: Mapping[str, object]) -> str:
        """The reply, as text."""
        self._client.say("call_service", id="q", service=service, args=args)
        for _ in range(1000):
            for message in self._client.heard():
                return json.dumps(message)
            await anyio.lowlevel.checkpoint()
        raise AssertionError(f"{service} did not answer")


def _about(graph: Graph) -> list[str]:
    """The services that are about the graph: rosapi's, and those of every node's parameters."""
    return [
        info.name
        for info in graph.services()
        if info.type.name in {**DISCLOSURES, **PARAMETER_DISCLOSURES, **LOGGERS}
    ]


def _requests(type: Any, word: str) -> Iterator[dict[str, object]]:
    """Requests in which each text names something called `word`, of every kind."""
    fields = msgspec.structs.fields(type.request.struct)
    for suffix in ("topic", "heard", "service", "action", "node", "param", "door"):
        for name in (f"/{word}_{suffix}", f"{word}_{suffix}", f"/{word}_node:{word}_param"):
            request: dict[str, object] = {}
            for field in fields:
                if field.type is str:
                    request[field.name] = "1.0" if field.name in ("value", "default_value") else name
                elif field.name in ("names", "prefixes"):
                    request[field.name] = [name]
                elif field.name == "parameters":
                    request[field.name] = [{"name": name, "value": {"type": 3, "double_value": 9.0}}]
            yield request


@pytest.mark.anyio
async def test_every_service_about_the_graph_declares_what_it_reveals(
    graph: MemoryGraph, distro: str
) -> None:
    names = _about(graph)
    assert len([name for name in names if name.startswith("/rosapi/")]) > 20
    undeclared = [
        info.name
        for info in graph.services()
        if info.name.startswith("/rosapi/")
        or info.type.name.startswith(("rosapi/", "rosapi_msgs/", "rcl_interfaces/"))
        if info.name not in names
    ]
    assert undeclared == []


@pytest.mark.anyio
async def test_no_answer_names_what_is_hidden(graph: MemoryGraph) -> None:
    asker = Asker(graph)
    for service in _about(graph):
        info = graph.service(service)
        assert info is not None
        assert HIDDEN not in (await asker.ask(service, {})).replace(service, ""), service
        for request in _requests(info.type, "open"):
            assert HIDDEN not in (await asker.ask(service, request)).replace(service, ""), (service, request)


@pytest.mark.anyio
async def test_what_is_hidden_is_answered_as_if_it_were_not_there(graph: MemoryGraph) -> None:
    asker = Asker(graph)
    for service in (name for name in _about(graph) if HIDDEN not in name):
        info = graph.service(service)
        assert info is not None
        pairs = zip(_requests(info.type, HIDDEN), _requests(info.type, ABSENT), strict=True)
        for hidden, absent in pairs:
            answers = [await asker.ask(service, request) for request in (hidden, absent)]
            assert answers[0].replace(HIDDEN, ABSENT) == answers[1], (service, hidden)


@pytest.mark.anyio
async def test_the_providers_of_a_type_are_those_of_services_that_are_shown(graph: MemoryGraph) -> None:
    asker = Asker(graph)
    shown = {"std_srvs/Trigger": ["/open_node"], "std_srvs/SetBool": [], "std_srvs/Empty": []}
    for type, nodes in shown.items():
        answer = json.loads(await asker.ask("/rosapi/service_providers", {"service": type}))
        assert answer["values"] == {"providers": nodes}, type


@pytest.mark.anyio
async def test_a_node_that_joins_is_seen_by_those_who_were_there_before(graph: MemoryGraph) -> None:
    asker = Asker(graph)
    before = json.loads(await asker.ask("/rosapi/nodes", {}))["values"]["nodes"]
    late = Node(graph, "late")
    late.advertise("/open_late", "std_msgs/String")
    assert json.loads(await asker.ask("/rosapi/nodes", {}))["values"]["nodes"] == sorted([*before, "/late"])
    late.close()
    assert json.loads(await asker.ask("/rosapi/nodes", {}))["values"]["nodes"] == before


@pytest.mark.anyio
async def test_a_service_about_the_graph_that_declares_nothing_is_refused(graph: MemoryGraph) -> None:
    Node(graph, "open_extra").advertise_service(
        "/rosapi/more", "std_srvs/Trigger", lambda _: {"success": True}
    )
    answer = json.loads(await Asker(graph).ask("/rosapi/more", {}))
    assert (answer["result"], "does not declare what it reveals" in answer["values"]) == (False, True)
    settings = _settings(GUEST)
    client = Client(Bridge(graph, settings, Access(graph, settings)))
    client.say("call_service", id="q", service="/rosapi/topics", args={})
    (reply,) = client.heard()
    assert reply["result"] is False


# -- pages -------------------------------------------------------------------------------------------------


def _pages(graph: MemoryGraph, settings: Settings) -> tuple[Any, tuple[HttpExtension, ...]]:
    bridge, extensions = _bridge(graph, settings), (WebVideoServer(graph).http,)
    return routes(bridge, ServerMetrics(bridge, extensions), extensions), extensions


async def _body(answer: Any) -> bytes:
    answer = await answer if inspect.isawaitable(answer) else answer
    assert isinstance(answer, HttpResponse)
    if isinstance(answer.body, bytes):
        return f"{answer.status} ".encode() + answer.body
    async for chunk in answer.body:
        return chunk
    return b""


@pytest.mark.anyio
async def test_no_page_names_what_is_hidden(graph: MemoryGraph) -> None:
    found, _ = _pages(graph, _settings(GUEST))
    for path in found.paths:
        handler = found.find("GET", path)
        assert callable(handler), path
        assert HIDDEN.encode() not in await _body(handler(HttpRequest("GET", path))), path
        answers = [
            await _body(handler(HttpRequest("GET", path, f"topic=/{word}_topic")))
            for word in (HIDDEN, ABSENT)
        ]
        assert answers[0].replace(HIDDEN.encode(), ABSENT.encode()) == answers[1], path


@pytest.mark.anyio
async def test_without_a_token_no_page_but_the_health_check_answers(graph: MemoryGraph) -> None:
    auth = {"tokens": {"t": {"token": "x" * 20, "role": "admin"}}}
    found, extensions = _pages(graph, _settings(GUEST, auth=auth))
    open_to_all = [
        route.path for its in extensions for route in its.routes if route.audience is Audience.ANYBODY
    ]
    for path in set(found.paths) - {"/healthz", *open_to_all}:
        handler = found.find("GET", path)
        assert callable(handler)
        assert (await _body(handler(HttpRequest("GET", path)))).startswith(b"401 "), path


@pytest.mark.anyio
async def test_metrics_are_for_those_who_may_subscribe_to_every_topic(graph: MemoryGraph) -> None:
    for globs, shown in ((["*"], True), (["/*"], True), (["/[!c]*"], False), (["/open*", "/?*"], False)):
        access = _access(graph, {"subscribe": globs})
        reader = GraphView(graph, access.admission.roles["guest"], access.nobody.work)
        assert reader.sees_every_topic is shown, globs


# -- gateways ----------------------------------------------------------------------------------------------


def _visit(graph: MemoryGraph, word: str) -> list[Any]:
    """Return the messages of Foxglove's gateway to a guest that requests everything, and the name `word`."""
    viewer = Viewer(FoxgloveGateway(graph, _access(graph, GUEST)))
    heard = viewer.welcome
    viewer.say("subscribeConnectionGraph")
    viewer.say("subscribe", subscriptions=[{"id": id, "channelId": id} for id in range(1, 200)])
    for id in range(1, 200):
        viewer.say_raw(struct.pack("<BIII", 2, id, 1, 4) + b"json{}", binary=True)
    names = [f"/{word}_node.{word}_param", f"/{word}_param"]
    viewer.say("getParameters", parameterNames=names, id="p")
    viewer.say("subscribeParameterUpdates", parameterNames=[])
    for topic in (f"/{word}_topic", f"/{word}_heard"):
        viewer.advertise(topic, "std_msgs/String")
    return [*heard, *viewer.heard()]


@pytest.mark.anyio
async def test_viewers_of_foxgloves_protocol_hear_nothing_of_what_is_hidden(graph: MemoryGraph) -> None:
    assert HIDDEN not in str(_visit(graph, "open"))
    for word in (HIDDEN, ABSENT):
        said = str(_visit(graph, word))
        # A refusal names what was asked for, and nothing else.
        assert HIDDEN not in said.replace(f"/{HIDDEN}_topic", "").replace(f"/{HIDDEN}_heard", "")


@pytest.mark.anyio
async def test_to_viewers_what_is_hidden_is_as_what_is_not_there(graph: MemoryGraph) -> None:
    hidden, absent = (
        [each for each in _visit(graph, word) if _is_of_viewer(each)] for word in (HIDDEN, ABSENT)
    )
    assert str(hidden).replace(HIDDEN, ABSENT) == str(absent)


def _is_of_viewer(said: Any) -> bool:
    """Return True unless a frame differs by session: serverInfo, or the time of day."""
    return isinstance(said, dict) and said["op"] in ("status", "advertise", "advertiseServices")
