"""Early looks of all gateways: a press with the right waits for nothing, and nothing else runs ahead.

The connections of a server send presses and what looks like one, in any order, while everything of theirs has
to wait. What runs ahead is held to :class:`LookModel`. The environment variable `GATE_MODEL_EXAMPLES` is the
number of runs.
"""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import partial
from typing import Any, cast

import bson
import cbor2
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from rwt.access.errors import AccessError
from rwt.access.graph_view import GraphView
from rwt.composition.pages import guarded
from rwt.extensions.foxglove.client import FoxgloveClient
from rwt.extensions.foxglove.errors import FoxgloveError
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.extensions.foxglove.wire import client_messages as said
from rwt.extensions.http.gateway import HttpGateway
from rwt.extensions.http.part import HttpSettings
from rwt.extensions.mcp.gateway import McpGateway
from rwt.extensions.mcp.settings import McpSettings
from rwt.gateways.base import ConnectedClient, Gateway
from rwt.gateways.early_look import SUSPENDED_SECONDS, EarlyLook, LookState, may_name_stop
from rwt.gateways.request_looks import RequestLooks
from rwt.gateways.visitors import peer_of
from rwt.rosbridge import Bridge
from rwt_transports.connection import ListenerState
from rwt_transports.http.connection import HttpConnection
from rwt_transports.http.routes import Audience, HttpRequest, HttpResponse, Routes, StopRequests
from rwt_transports.limits import Limits
from rwt_transports.scheduler import MESSAGES, REQUESTS, Scheduler
from rwt_transports.websocket.wire import WebSocketWire
from tests.core.access.gated_robot import GatedRobot, settings_of, token
from tests.core.access.test_work import BusyClock
from tests.core.rosbridge.recording_client import Client
from tests.core.transports.test_http import nobody
from tests.extensions.foxglove.viewer import Viewer
from tests.memory_pipe import MemoryPipe

EXAMPLES = int(os.environ.get("GATE_MODEL_EXAMPLES", "40"))
RULES = {"drive": {"topics": ["/cmd_vel"], "emergency": True, "stop": {}}}
STOP_ROLES = ["operator", "supervisor"]


MENTION: dict[str, Any] = {"topic": "/a", "type": "std_msgs/String", "msg": {"data": "/gate/stop"}}


class Kind(Enum):
    """What a connection sends."""

    CALL = auto()
    MESSAGE = auto()
    WRONG = auto()
    """A call of the stop with a request that does not fit."""
    MENTION = auto()
    """A message on another topic, with the name of the stop in a string."""
    OTHER = auto()


class Wire(ABC):
    """One connection, whose frames all have to wait.

    Attributes:
        mentions: True if the name of the stop in a string causes a look.
    """

    mentions = True

    def __init__(self, robot: GatedRobot, role: str) -> None:
        self.robot = robot
        self.role = role
        self.looks = 0

    @abstractmethod
    def send(self, kind: Kind) -> bool:
        """Send a frame; returns True if it was run ahead of what waits."""

    @abstractmethod
    def take_role(self, role: str) -> None:
        """Switch to another role."""


class ConnectedWire(Wire):
    """Connection of a gateway whose clients stay connected."""

    client: ConnectedClient[Any, Any]

    def observe(self) -> None:
        """Count the looks."""
        client: Any = self.client
        decode = client._presses_stop

        def presses_stop(data: bytes, binary: bool) -> bool:
            self.looks += 1
            found: bool = decode(data, binary)
            return found

        client._presses_stop = presses_stop

    def send(self, kind: Kind) -> bool:
        if not self.client._waiting:
            self.client._wait_unread(b"{}", False)
        before = self.client.messages
        self.say(kind)
        return self.client.messages > before

    @abstractmethod
    def say(self, kind: Kind) -> None: ...

    def take_role(self, role: str) -> None:
        self.role = role
        self.client.take_role(self.robot.access.admission.roles[role])
        self.client.withdraw_refused()


class Rosbridge(ConnectedWire):
    """Client of rosbridge in one encoding."""

    def __init__(
        self,
        robot: GatedRobot,
        role: str,
        bridge: Bridge | None = None,
        encode: Callable[[dict[str, Any]], bytes] = lambda op: json.dumps(op).encode(),
        *,
        binary: bool = False,
    ) -> None:
        super().__init__(robot, role)
        self._client = Client(bridge or robot.bridge, headers={"authorization": f"Bearer {token(role)}"})
        self._encode = encode
        self._binary = binary
        self.client = self._client.peer
        self.observe()

    def say(self, kind: Kind) -> None:
        op: dict[str, Any] = {
            Kind.CALL: {"op": "call_service", "service": "gate/stop", "args": {"reason": "now"}},
            Kind.MESSAGE: {"op": "publish", "topic": "/gate/stop", "msg": {}},
            Kind.WRONG: {"op": "call_service", "service": "/gate/stop", "args": {"reason": 5}},
            Kind.MENTION: {"op": "publish", **MENTION},
            Kind.OTHER: {"op": "subscribe", "topic": "/gate/stopped"},
        }[kind]  # fmt: skip
        self._client.say_raw(self._encode(op), self._binary)


class Foxglove(ConnectedWire):
    """Client of Foxglove's protocol, which may advertise the stop."""

    mentions = False

    def __init__(self, robot: GatedRobot, role: str, gateway: FoxgloveGateway) -> None:
        super().__init__(robot, role)
        self._viewer = Viewer(gateway, headers={"authorization": f"Bearer {token(role)}"})
        self._viewer.advertise("/gate/stop", "std_msgs/Empty")
        self._viewer.advertise("/a", "std_msgs/String", id=2)
        self.client = self._viewer.client
        self.observe()

    def say(self, kind: Kind) -> None:
        match kind:
            case Kind.CALL:
                self._viewer.call("/gate/stop", b'{"reason": "now"}')
            case Kind.MESSAGE:
                self._viewer.publish(b"{}")
            case Kind.WRONG:
                self._viewer.call("/gate/stop", b'{"reason": 5}')
            case Kind.MENTION:
                self._viewer.publish(b'{"data": "/gate/stop"}', id=2)
            case Kind.OTHER:
                self._viewer.say("unsubscribe", subscriptionIds=[7])

    def take_role(self, role: str) -> None:
        super().take_role(role)
        # A role that may not press the stop has ended the channel.
        channel = said.ClientChannel(id=1, topic="/gate/stop", encoding="json", schema_name="std_msgs/Empty")
        with suppress(AccessError, FoxgloveError):
            cast("FoxgloveClient", self.client).publications.advertise(channel)


class Requests(Wire):
    """Connection over HTTP, whose address is beyond its rate of work."""

    def __init__(self, robot: GatedRobot, role: str, gateway: Gateway, looks: RequestLooks) -> None:
        super().__init__(robot, role)
        self._routes = {each.path: each for each in gateway.http.routes if each.method == "POST"}
        self._looks = looks
        self._connection = object()

    def ask(self, route: str, path: str, body: object) -> bool:
        """Send a request; returns True if it was served."""
        headers = {"authorization": f"Bearer {token(self.role)}", "content-type": "application/json"}
        data = json.dumps(body).encode()
        request = HttpRequest("POST", path, "", headers, data, "192.0.2.1", "", self._connection)
        self.robot.access.reader(peer_of(request)).work.add(1000.0, "pages")
        row = self._routes[route]
        assert row.stop is not None
        way = StopRequests(row.stop.may_press, partial(self._look, row.stop))
        press = partial(self._looks.press, way)
        page = guarded(self.robot.access, lambda *_: HttpResponse(), Audience.ADMITTED, press=press)
        answer = page(request)
        assert isinstance(answer, HttpResponse)
        return answer.status == 200

    def _look(self, way: StopRequests[GraphView], request: HttpRequest, reader: GraphView) -> None:
        self.looks += 1
        way.press(request, reader)

    def take_role(self, role: str) -> None:
        self.role = role


class Http(Requests):
    """Connection to the HTTP gateway."""

    mentions = False

    def send(self, kind: Kind) -> bool:
        services, topics = "/api/services/*", "/api/topics/*"
        match kind:
            case Kind.CALL:
                return self.ask(services, "/api/services/gate/stop", {"reason": "now"})
            case Kind.MESSAGE:
                return self.ask(topics, "/api/topics/gate/stop", {})
            case Kind.WRONG:
                return self.ask(services, "/api/services/gate/stop", {"reason": 5})
            case Kind.MENTION:
                return self.ask(topics, "/api/topics/a", {"data": "/gate/stop"})
            case Kind.OTHER:
                return self.ask("/api/actions/*", "/api/actions/gate/stop", {})


class Agent(Requests):
    """Connection of an agent."""

    def send(self, kind: Kind) -> bool:
        name, arguments = {
            Kind.CALL: ("call_service", {"service": "/gate/stop", "request": {"reason": "now"}}),
            Kind.MESSAGE: ("publish", {"topic": "/gate/stop", "message": {}}),
            Kind.WRONG: ("call_service", {"service": "/gate/stop", "request": {"reason": 5}}),
            Kind.MENTION: ("publish", {"topic": "/a", "message": {"data": "/gate/stop"}}),
            Kind.OTHER: ("read_topic", {"topic": "/gate/stopped"}),
        }[kind]
        params = {"name": name, "arguments": arguments}
        body = {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": params}
        return self.ask("/mcp", "/mcp", body)


@dataclass
class LookModel:
    """What is known of the looks of one connection.

    Attributes:
        used_in: turn of its last look.
        suspended_until: time from which it has looks again.
    """

    used_in: int = -1
    suspended_until: float = 0.0

    def expect(
        self, kind: Kind, *, has_right: bool, mentions: bool, turn: int, now: float
    ) -> tuple[bool, bool]:
        """Return whether a frame is run ahead, and whether it stops the robot.

        Args:
            has_right: True if the role may press the stop, which is not pressed.
            mentions: as :attr:`Wire.mentions`.
        """
        is_named = kind in (Kind.CALL, Kind.MESSAGE, Kind.WRONG) or (kind is Kind.MENTION and mentions)
        if not has_right or not is_named or turn == self.used_in or now < self.suspended_until:
            return False, False
        presses = kind in (Kind.CALL, Kind.MESSAGE)
        self.used_in = turn
        if not presses:
            self.suspended_until = now + SUSPENDED_SECONDS
        return kind is not Kind.MENTION, presses


@dataclass
class Held:
    """A connection with its model, and its number of looks in this turn."""

    wire: Wire
    model: LookModel = field(default_factory=LookModel)
    looks: int = 0


class EarlyLooks(RuleBasedStateMachine):
    """Connections of every gateway, which send anything in any order."""

    @initialize(roles=st.lists(st.sampled_from(["operator", "supervisor", "agent"]), min_size=6, max_size=6))
    def start(self, roles: list[str]) -> None:
        self.robot = robot = GatedRobot(RULES, emergency={"stop_roles": STOP_ROLES})
        only_bson = Bridge(robot.graph, settings_of({}, bson_only_mode=True), robot.access)
        foxglove = FoxgloveGateway(robot.graph, robot.access)
        http = HttpGateway(robot.graph, robot.access, HttpSettings())
        agents = McpGateway(robot.graph, robot.access, McpSettings())
        self.schedulers = robot.bridge.scheduler, only_bson.scheduler, foxglove.scheduler
        looks = RequestLooks(robot.access, robot.bridge.scheduler)
        make: tuple[Callable[[str], Wire], ...] = (
            lambda role: Rosbridge(robot, role),
            lambda role: Rosbridge(robot, role, None, cbor2.dumps, binary=True),
            lambda role: Rosbridge(robot, role, only_bson, bson.encode, binary=True),
            lambda role: Foxglove(robot, role, foxglove),
            lambda role: Http(robot, role, http, looks),
            lambda role: Agent(robot, role, agents, looks),
        )
        self.held = [Held(each(role)) for each, role in zip(make, roles, strict=True)]
        self.turn = 0

    @rule(which=st.integers(0, 5), kind=st.sampled_from(Kind))
    def send(self, which: int, kind: Kind) -> None:
        held, gate = self.held[which], self.robot.gate
        wire, was_stopped = held.wire, bool(gate.stopped_by)
        looks = wire.looks
        has_right = wire.role in STOP_ROLES and not was_stopped
        ahead, stops = held.model.expect(
            kind,
            has_right=has_right,
            mentions=wire.mentions,
            turn=self.turn,
            now=self.robot.clock.monotonic(),
        )
        # A request that does not press is answered like any other, so beyond its rate it is refused.
        expected = (ahead and stops) if isinstance(wire, Requests) else ahead
        assert wire.send(kind) == expected
        assert bool(gate.stopped_by) == (was_stopped or stops)
        held.looks += wire.looks - looks

    @rule(which=st.integers(0, 5), role=st.sampled_from(["operator", "supervisor", "agent"]))
    def take_role(self, which: int, role: str) -> None:
        self.held[which].wire.take_role(role)

    @precondition(lambda self: self.robot.gate.stopped_by)
    @rule()
    def release(self) -> None:
        self.robot.gate.release(None)

    @rule(seconds=st.sampled_from([0.001, 0.001, 0.4, SUSPENDED_SECONDS]))
    def pass_time(self, seconds: float) -> None:
        """Run what waits in turns of its own, and let time pass."""
        self.robot.clock.advance(seconds)
        self.turn += 1
        for held in self.held:
            held.looks = 0

    @invariant()
    def no_connection_has_two_looks_in_a_turn(self) -> None:
        assert all(held.looks <= 1 for held in getattr(self, "held", ()))


TestEarlyLooks = EarlyLooks.TestCase
TestEarlyLooks.settings = settings(max_examples=EXAMPLES, stateful_step_count=40, deadline=None)


# -- the look itself -----------------------------------------------------------------------------------------


def _look() -> tuple[EarlyLook, list[Callable[[], None]], list[float]]:
    """Return a look, what begins the next turn, and the time."""
    soon: list[Callable[[], None]] = []
    time = [0.0]
    turns = Scheduler(MESSAGES, soon.append, lambda seconds, call: soon.append(call), lambda: time[0])
    return EarlyLook(turns), soon, time


def test_a_look_that_stopped_the_robot_is_the_only_one_of_its_turn() -> None:
    look, soon, _ = _look()
    assert look.begin()
    assert not look.begin()
    look.end(is_stopped=True)
    assert not look.begin()
    soon.pop()()
    assert look.state is LookState.READY


def test_a_look_that_stopped_nothing_is_the_only_one_of_a_second() -> None:
    look, _, time = _look()
    assert look.begin()
    look.end(is_stopped=False)
    time[0] = SUSPENDED_SECONDS - 0.001
    assert not look.begin()
    time[0] = SUSPENDED_SECONDS
    assert look.begin()


def test_looks_of_requests_are_kept_no_longer_than_they_count() -> None:
    robot = GatedRobot(RULES)
    looks = RequestLooks(robot.access, robot.bridge.scheduler)
    way: StopRequests[GraphView] = StopRequests(lambda request, reader: True, lambda request, reader: None)
    for _ in range(3):
        for _ in range(100):
            request = HttpRequest("POST", "/", connection=object())
            assert not looks.press(way, request, robot.access.nobody)
            assert not looks.press(way, request, robot.access.nobody)
        assert len(looks._looks) == 100
        robot.clock.advance(SUSPENDED_SECONDS)


@pytest.mark.parametrize(
    ("frame", "is_named"),
    [
        (b'{"op":"call_service","service":"/gate/stop"}', True),
        (rb'{"op":"call_service","service":"\/gate\/stop"}', True),
        (b'{"op":"publish","topic":"gate/stop"}', True),
        (b'{"op":"subscribe","topic":"/gate/stop"}', False),
        (b'{"op":"advertise","topic":"/gate/stop","type":"std_msgs/Empty"}', False),
        (b'{"op":"publish","topic":"/gate/stopped"}', False),
        (b'{"op":"publish","topic":"/cmd_vel"}', False),
    ],
)
def test_only_frames_that_may_press_are_looked_at(frame: bytes, is_named: bool) -> None:
    assert may_name_stop(frame) is is_named


# -- requests that wait to be read ---------------------------------------------------------------------------


class Busy:
    """Server whose turn of requests is full, with HTTP connections of one role each.

    Attributes:
        begins_turn: begins the next turn.
    """

    def __init__(self, robot: GatedRobot, gateway: Gateway) -> None:
        self.begins_turn: list[Callable[[], None]] = []
        self.routes = Routes()
        self.routes.early = looks = RequestLooks(robot.access, robot.bridge.scheduler)
        for row in gateway.http.routes:
            assert row.stop is not None
            looks.add(row.path, row.stop)
            press = partial(looks.press, row.stop)
            page = guarded(robot.access, lambda *_: HttpResponse(b"done"), Audience.ADMITTED, press=press)
            self.routes.add(row.path, page, row.method)

    def connect(self) -> MemoryPipe:
        soon = self.begins_turn.append
        requests = Scheduler(REQUESTS, soon, lambda seconds, call: soon(call))
        http = partial(HttpConnection, self.routes)
        state = ListenerState(nobody, WebSocketWire, Limits(), http, "ws", requests=requests)
        requests.note(1.0)
        return MemoryPipe(state.attach, "192.0.2.1", 4321)


def _raw(body: bytes, role: str = "operator", path: str = "/api/services/gate/stop") -> bytes:
    head = f"POST {path} HTTP/1.1\r\nHost: r2\r\nAuthorization: Bearer {token(role)}\r\n"
    return f"{head}Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body


PRESS = b'{"reason": "now"}'


@pytest.fixture
def busy() -> tuple[GatedRobot, Busy]:
    robot = GatedRobot(RULES, emergency={"stop_roles": STOP_ROLES})
    return robot, Busy(robot, HttpGateway(robot.graph, robot.access, HttpSettings()))


@pytest.mark.parametrize("cut", [10_000, 20, 150, -5])
def test_a_press_that_waits_to_be_read_is_read_once_it_is_complete(
    busy: tuple[GatedRobot, Busy], cut: int
) -> None:
    robot, server = busy
    pipe = server.connect()
    data = _raw(PRESS)
    pipe.send(data[:cut])
    if cut < len(data):
        assert not robot.gate.stopped_by
        pipe.send(data[cut:])
    assert robot.gate.stopped_by.startswith("http:1")
    assert pipe.receive().startswith(b"HTTP/1.1 200")
    while server.begins_turn:
        server.begins_turn.pop(0)()
    assert pipe.receive() == b"", "it is answered once"


def test_only_a_press_with_the_right_is_read_ahead(
    busy: tuple[GatedRobot, Busy], caplog: pytest.LogCaptureFixture
) -> None:
    robot, server = busy
    for data in (
        _raw(PRESS, "agent"),
        _raw(PRESS, "nobody"),
        _raw(b"{}", path="/api/services/other"),
        _raw(PRESS, path="/api/actions/gate/stop"),
        _raw(PRESS).replace(b"Content-Length", b"Content-Size"),
        _raw(PRESS + b" " * 9000),
        b"\r\n\r\nstop",
    ):
        pipe = server.connect()
        pipe.send(data)
        assert pipe.receive() == b""
    assert (robot.gate.stopped_by, caplog.text) == ("", "")


def test_a_request_that_presses_nothing_is_read_ahead_once_a_second(busy: tuple[GatedRobot, Busy]) -> None:
    robot, server = busy
    pipe = server.connect()
    pipe.send(_raw(b'{"reason": 5}'))
    assert pipe.receive().startswith(b"HTTP/1.1 200")
    pipe.send(_raw(PRESS))
    assert (pipe.receive(), robot.gate.stopped_by) == (b"", ""), "it waits"
    server.connect().send(_raw(PRESS))
    assert robot.gate.stopped_by, "another connection has a look of its own"


def test_a_page_of_another_origin_does_not_press(busy: tuple[GatedRobot, Busy]) -> None:
    robot, server = busy
    pipe = server.connect()
    pipe.send(_raw(PRESS).replace(b"Host: r2", b"Host: r2\r\nOrigin: https://elsewhere.example"))
    assert pipe.receive().startswith(b"HTTP/1.1 403")
    pipe.send(_raw(PRESS))
    assert not robot.gate.stopped_by, "its look was used"


# -- what a look costs ---------------------------------------------------------------------------------------

WRONG: dict[str, Any] = {"service": "/gate/stop", "args": {"reason": 5}}


def _limited(rate: float, burst: int) -> tuple[GatedRobot, Client]:
    robot = GatedRobot(RULES)
    limits = {"messages_per_second": rate, "messages_burst": burst}
    robot.access.limits = robot.access.limits.model_copy(update=limits)
    return robot, robot.client()


def test_a_look_that_stops_nothing_counts_towards_the_rate() -> None:
    robot, client = _limited(1, 3)  # One message was the client's level.
    client.peer._wait_unread(b"{}", False)
    client.say("call_service", **WRONG)
    client.say("call_service", **WRONG)
    assert (client.close_code, client.peer.messages) == (None, 2), "the second waits"
    robot.clock.advance(0.001)
    assert client.close_code == 1008, "three messages, of which one was read ahead, and the level"


def test_wrong_presses_beyond_the_rate_disconnect() -> None:
    _, client = _limited(1, 3)
    for _ in range(20):
        client.say("call_service", **WRONG)
    assert (client.close_code, client.close_reason) == (
        1008,
        "more than 1 messages a second (limits.messages_per_second)",
    )


def test_a_look_is_charged_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = BusyClock()
    robot = GatedRobot(RULES, clock=clock)
    client = robot.client()
    peer: Any = client.peer
    peer._wait_unread(b"{}", False)
    run = peer._run

    def slow(messages: Any, now: float) -> None:
        clock.worked += 0.0005
        run(messages, now)

    monkeypatch.setattr(peer, "_run", slow)
    before, refusals = peer.graph.work.seconds, dict(robot.bridge.shared.counters.refusals)
    client.say("call_service", **WRONG)
    assert peer.graph.work.seconds - before == pytest.approx(0.0005)
    refused = robot.bridge.shared.counters.refusals.get("call_service", 0)
    assert refused == refusals.get("call_service", 0) + 1


def test_a_frame_that_mentions_the_stop_costs_no_more_than_one_look_a_second() -> None:
    robot = GatedRobot(RULES)
    client = robot.client()
    peer: Any = client.peer
    looks: list[bytes] = []

    def presses_stop(data: bytes, binary: bool) -> bool:
        looks.append(data)
        return False

    peer._presses_stop = presses_stop
    peer._wait_unread(b"{}", False)
    for _ in range(100):
        client.say("publish", **MENTION)
    assert len(looks) == 1
    client.say("publish", topic="/a", type="std_msgs/String", msg={"data": "/gate/stop" + "x" * 5000})
    robot.clock.advance(SUSPENDED_SECONDS)
    peer._wait_unread(b"{}", False)
    client.say("publish", topic="/a", type="std_msgs/String", msg={"data": "/gate/stop" + "x" * 5000})
    assert len(looks) == 1, "larger frames are not looked at"


def test_the_right_is_known_before_a_frame_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = GatedRobot(RULES, emergency={"stop_roles": STOP_ROLES})
    client = robot.client("agent")
    peer: Any = client.peer
    peer._names_stop = lambda data, binary: pytest.fail("the role may not press")
    peer._wait_unread(b"{}", False)
    client.say("call_service", service="/gate/stop", args={})
    compiled: list[object] = []
    monkeypatch.setattr("rwt.access.gate.gate.glob_pattern", compiled.append)
    client.say("call_service", service="/gate/stop", args={})
    assert not compiled, "the right of a role is cached"


def test_in_mode_observe_a_press_is_a_message_like_any_other() -> None:
    robot = GatedRobot(RULES, mode="observe")
    client = robot.client()
    client.peer._wait_unread(b"{}", False)
    client.say("call_service", service="/gate/stop", args={})
    assert robot.gate.presses == 0
    robot.clock.advance(0.001)
    assert robot.gate.presses == 1


def test_a_reload_renews_who_may_press() -> None:
    robot = GatedRobot(RULES, emergency={"stop_roles": STOP_ROLES})
    client = robot.client("agent")
    assert not client.peer.graph.is_stop_due
    settings_now = settings_of({"rules": RULES, "emergency": {"stop_roles": ["agent"]}})
    robot.gate.replace_rules(settings_now.gate)
    assert client.peer.graph.is_stop_due


def test_one_connection_does_not_suspend_another_of_the_same_credential() -> None:
    robot = GatedRobot(RULES)
    flood, operator = robot.clients("operator", "operator")
    flood.peer._wait_unread(b"{}", False)
    operator.peer._wait_unread(b"{}", False)
    flood.say("call_service", **WRONG)
    operator.say("call_service", service="/gate/stop", args={})
    assert robot.gate.stopped_by.startswith("rosbridge:2")
