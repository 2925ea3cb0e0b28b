"""Clients of several credentials and gateways do anything in any order: the gate is held to the model.

The robot receives exactly what :mod:`tests.core.access.gate_model` admits, and the stop message whenever the
model says so. The environment variable `GATE_MODEL_EXAMPLES` is the number of runs.
"""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import cycle
from typing import Any

import bson
import cbor2
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    MultipleResults,
    RuleBasedStateMachine,
    consumes,
    initialize,
    invariant,
    multiple,
    precondition,
    rule,
)

from rwt import Settings
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.extensions.http.gateway import HttpGateway
from rwt.extensions.http.part import HttpSettings
from rwt.gateways.base import Gateway
from rwt.rosapi import Rosapi
from rwt.rosbridge import Bridge
from rwt_graph import SimulatedClock
from rwt_transports.http.routes import HttpResponse
from tests.core.access.gate_model import LEASE_SECONDS, LIMITS, PRECEDENCE, Fault, GateModel, Person
from tests.core.access.gated_robot import FIBONACCI, GATE, TWIST, GatedRobot, HttpClient, settings_of, token
from tests.core.rosbridge.recording_client import Client
from tests.extensions.foxglove.viewer import Response, Viewer

pytestmark = pytest.mark.slow

EXAMPLES = int(os.environ.get("GATE_MODEL_EXAMPLES", "25"))
PACE = 0.05
"""Seconds between two commands."""
CREDENTIALS = {"agent": "agent", "operator": "operator", "operator2": "operator", "supervisor": "supervisor"}
GATEWAYS = ("json", "foxglove", "cbor", "http", "bson")
COMMANDS = st.tuples(
    st.sampled_from([0.5, 0.0, 0.75, 1.5, 3.0]),
    st.sampled_from([Fault.NONE, Fault.NONE, Fault.NONE, Fault.FIELD]),
)
STALLED = "waited in a stalled connection"
LEASE, STOP = "rwt_gate_msgs/Lease", "rwt_gate_msgs/Stop"


def rules_of(take: str, limit: float) -> dict[str, object]:
    lease = {"seconds": LEASE_SECONDS, "take": take, "precedence": PRECEDENCE}
    fields = {"linear.x": {"max": limit, "beyond": "clamp"}, "linear.y": {"max": 0}}
    return {
        "drive": {"topics": ["/cmd_vel"], "lease": lease, "stop": {}, "emergency": True, "fields": fields},
        "asked": {
            "services": ["/blink"],
            "emergency": True,
            "approval": {"roles": ["supervisor"], "seconds": 3600},
        },
        "acts": {"actions": ["/count"], "parameters": ["*limit"], "emergency": True},
    }


class JumpingClock(SimulatedClock):
    """Clock whose wall time is set.

    Attributes:
        ahead_ns: how far the wall time is ahead.
    """

    ahead_ns = 0

    def time_ns(self) -> int:
        return super().time_ns() + self.ahead_ns


class Wire(ABC):
    """Client over one gateway.

    Attributes:
        person: the same client in the model.
        is_request: True if each request is a client of its own, which leaves with the answer.
    """

    is_request = False

    def __init__(self, credential: str) -> None:
        self.person = Person(CREDENTIALS[credential], credential)

    @abstractmethod
    def publish(self, message: dict[str, Any]) -> str:
        """Publish a velocity; returns the error, empty if there is none."""

    @abstractmethod
    def ask(self, service: str, arguments: dict[str, object]) -> dict[str, Any] | None:
        """Call a service; returns its answer, and None if it waits or is rejected."""

    @abstractmethod
    def leave(self) -> bool:
        """Disconnect; returns False if this is not possible."""


class RosbridgeWire(Wire):
    """Client of rosbridge in one encoding."""

    def __init__(self, bridge: Bridge, credential: str, encoding: str) -> None:
        super().__init__(credential)
        self._encoding = encoding
        self.client = Client(bridge, headers={"authorization": f"Bearer {token(credential)}"})
        self.person.name = self.client.peer.graph.gate_name
        self.say(op="set_level", level="error")

    def say(self, **op: object) -> list[dict[str, Any]]:
        """Send an op, and return all answers."""
        encode: dict[str, Callable[[Any], bytes]] = {"cbor": cbor2.dumps, "bson": bson.encode}
        text = json.dumps(op).encode()
        data = encode[self._encoding](op) if self._encoding in encode else text
        self.client.frames.clear()  # Late answers of approved calls.
        self.client.say_raw(data, binary=self._encoding in encode)
        frames, self.client.frames = self.client.frames, []
        return [
            bson.decode(frame.data) if self._encoding == "bson" else json.loads(frame.data)
            for frame, _ in frames
        ]

    def publish(self, message: dict[str, Any]) -> str:
        told = self.say(op="publish", topic="/cmd_vel", type=TWIST, msg=message)
        return " ".join(each["msg"] for each in told if each["op"] == "status" and each["level"] == "error")

    def ask(self, service: str, arguments: dict[str, object]) -> dict[str, Any] | None:
        told = self.say(op="call_service", service=service, args=arguments)
        answers = [each for each in told if each["op"] == "service_response" and each["result"]]
        return answers[0]["values"] if answers else None

    def leave(self) -> bool:
        self.client.leave()
        return True


class FoxgloveWire(Wire):
    """Client of Foxglove's protocol."""

    def __init__(self, gateway: FoxgloveGateway, credential: str) -> None:
        super().__init__(credential)
        self._viewer = Viewer(gateway, headers={"authorization": f"Bearer {token(credential)}"})
        self._viewer.advertise("/cmd_vel", "geometry_msgs/msg/Twist")
        self._viewer.heard()

    def publish(self, message: dict[str, Any]) -> str:
        self._viewer.heard()
        self._viewer.publish(json.dumps(message).encode())
        told = self._viewer.heard()
        return " ".join(
            each["message"]
            for each in told
            if isinstance(each, dict) and each.get("op") == "status" and each["level"] == 2
        )

    def ask(self, service: str, arguments: dict[str, object]) -> dict[str, Any] | None:
        self._viewer.call(service, json.dumps(arguments).encode())
        answers = [each for each in self._viewer.heard() if isinstance(each, Response)]
        values: dict[str, Any] | None = json.loads(answers[0].payload) if answers else None
        return values

    def leave(self) -> bool:
        self._viewer.leave()
        return True


class HttpWire(Wire):
    """Client over HTTP, one for each credential."""

    def __init__(self, robot: GatedRobot, gateway: HttpGateway, credential: str) -> None:
        super().__init__(credential)
        self._client = HttpClient(robot, gateway)

    def _post(self, path: str, body: object) -> HttpResponse:
        return self._client.request("POST", path, json.dumps(body).encode(), self.person.credential)

    def publish(self, message: dict[str, Any]) -> str:
        answer = self._post("/api/topics/cmd_vel", message)
        assert isinstance(answer.body, bytes)
        return "" if answer.status < 300 else answer.body.decode()

    def ask(self, service: str, arguments: dict[str, object]) -> dict[str, Any] | None:
        answer = self._post(f"/api/services{service}", arguments)
        assert isinstance(answer.body, bytes)
        return json.loads(answer.body) if answer.status < 300 else None

    def leave(self) -> bool:
        return False


class GateMachine(RuleBasedStateMachine):
    """Robot behind a gate, and the model of it.

    Attributes:
        gateways: kinds of wires.
    """

    gateways = GATEWAYS
    wires = Bundle("wires")

    @initialize(target=wires, take=st.sampled_from(["publish", "service"]))
    def start(self, take: str) -> MultipleResults[Wire]:
        return multiple(*self._start(take))

    def _start(self, take: str) -> list[Wire]:
        self.take = take
        self.model = GateModel(by_service=take == "service")
        self.robot = robot = self._make_robot()
        self.began = robot.clock.monotonic()
        # So that the type is known before anybody has published.
        robot.node.advertise("/cmd_vel", TWIST)
        robot.node.parameters.declare("limit", 0.0)
        self.requests = robot.offer("/blink")
        self.goals, _ = robot.accept_goals("/count")
        self._serve()
        return [
            self._connect(credential, gateway)
            for credential, gateway in zip(cycle(sorted(CREDENTIALS)), self.gateways * 2, strict=False)
        ]

    def _make_robot(self) -> GatedRobot:
        clock = JumpingClock(1_700_000_000 * 10**9)
        robot = GatedRobot(**self._gate(LIMITS[0]), clock=clock)
        Rosapi(robot.graph)
        return robot

    def _gate(self, limit: float) -> dict[str, Any]:
        return {"rules": rules_of(self.take, limit), "emergency": {"release_roles": ["*"]}}

    def _serve(self) -> None:
        robot = self.robot
        bson_settings = settings_of({}, bson_only_mode=True)
        self.bridges = {
            "json": robot.bridge,
            "cbor": robot.bridge,
            "bson": Bridge(robot.graph, bson_settings, robot.access),
        }
        self.foxglove = FoxgloveGateway(robot.graph, robot.access)
        self.http = HttpGateway(robot.graph, robot.access, HttpSettings())
        self.of_http: dict[str, HttpWire] = {}

    @property
    def blinks(self) -> list[bool]:
        """Values of the calls that reached the robot."""
        return [each.data for each in self.requests]

    def _now(self) -> float:
        return self.robot.clock.monotonic() - self.began

    def _require_stop(self) -> None:
        assert self.robot.heard[-1:] == [(0.0, GATE)], "the robot was not told to stop"

    # Clients

    @rule(
        target=wires,
        credential=st.sampled_from(sorted(CREDENTIALS)),
        gateway=st.sampled_from(GATEWAYS),
    )
    def connect(self, credential: str, gateway: str) -> Wire:
        return self._connect(credential, gateway)

    def _connect(self, credential: str, gateway: str) -> Wire:
        if gateway == "foxglove":
            return FoxgloveWire(self.foxglove, credential)
        if gateway != "http":
            return RosbridgeWire(self.bridges[gateway], credential, gateway)
        if credential not in self.of_http:
            self.of_http[credential] = HttpWire(self.robot, self.http, credential)
        return self.of_http[credential]

    @rule(wire=consumes(wires))
    def leave(self, wire: Wire) -> None:
        self.robot.take()
        if not wire.leave():
            return
        self.model.pending = {
            id: each for id, each in self.model.pending.items() if each[0] is not wire.person
        }
        if self.model.lose(wire.person):
            self._require_stop()

    # Commands

    @rule(
        one=wires, other=wires, turns=st.integers(2, 6), commands=st.lists(COMMANDS, min_size=1, max_size=4)
    )
    def drive(self, one: Wire, other: Wire, turns: int, commands: list[tuple[float, Fault]]) -> None:
        """Two clients publish in turns."""
        for _, wire, command in zip(range(turns), cycle((one, other)), cycle(commands), strict=False):
            self._publish(wire, *command)

    @rule(wire=wires, command=COMMANDS)
    def publish(self, wire: Wire, command: tuple[float, Fault]) -> None:
        self._publish(wire, *command)

    def _publish(self, wire: Wire, speed: float, fault: Fault) -> None:
        self.wait(round(PACE * 1000))
        self.robot.take()
        holder = self.model.holder
        said = wire.publish({"linear": {"x": speed, "y": float(fault is Fault.FIELD)}, "angular": {}})
        if STALLED in said:
            # Stricter than this model; its own tests hold it to what it promises.
            assert not self.model.is_stopped
            expected = [(0.0, GATE)] if wire.person is holder else []
            assert self.robot.take() == expected
            self.model.lose(wire.person)
            self.model.paused.pop(wire.person.credential, None)
            return
        admitted = self.model.publish(wire.person, speed, fault)
        heard = [value for value, node in self.robot.heard if node != GATE]
        assert heard == ([] if admitted is None else [admitted]), (heard, self.model)
        assert bool(said) is (admitted is None), said
        if admitted is not None and not self._end_request(wire):
            self._learn_name(wire)

    def _end_request(self, wire: Wire) -> bool:
        """Note the end of a request that was a client; returns True if it was one."""
        if wire.is_request and self.model.lose(wire.person):
            self._require_stop()
        return wire.is_request

    def _learn_name(self, wire: Wire) -> None:
        (lease,) = [topic.lease for topic in self.robot.gate.topics if topic.name == "/cmd_vel"]
        assert lease is not None
        assert lease.holder is not None
        name = lease.holder.name
        # An idle client over HTTP gets another name when it returns.
        assert wire.person.name in ("", name) or isinstance(wire, HttpWire)
        wire.person.name = name

    @rule(wire=wires, value=st.booleans())
    def call(self, wire: Wire, value: bool) -> None:
        if isinstance(wire, HttpWire) or wire.is_request:  # Its request would wait.
            return
        before = self.blinks
        wire.ask("/blink", {"data": value})
        assert self.blinks == before, "a call needs approval"
        new = set(self._waiting()) - set(self.model.pending)
        of_credential = [
            each for each, _ in self.model.pending.values() if each.credential == wire.person.credential
        ]
        if self.model.is_stopped or len(of_credential) >= 20:
            assert not new
        else:
            (id,) = new
            self.model.pending[id] = (wire.person, value)

    def _waiting(self) -> list[str]:
        self.wait(1)
        return [each.id for each in self.robot.gate.approvals.pending]

    @precondition(lambda self: self.model.pending)
    @rule(wire=wires, data=st.data(), is_approved=st.booleans())
    def approve(self, wire: Wire, data: st.DataObject, is_approved: bool) -> None:
        id = data.draw(st.sampled_from(sorted(self.model.pending)))
        before = self.blinks
        answer = wire.ask("/gate/approve", {"id": id, "approve": is_approved, "seconds": 0.0})
        assert answer is not None
        who, value = self.model.pending[id]
        # A client cannot answer its own request, nor can another one with its token.
        may = wire.person.role == "supervisor" and wire.person.credential != who.credential
        assert answer["success"] is may, answer
        if may:
            del self.model.pending[id]
        assert self.blinks == [*before, *([value] if may and is_approved else [])]

    @rule(wire=wires)
    def send_goal(self, wire: Wire) -> None:
        if not isinstance(wire, RosbridgeWire):
            return
        before = len(self.goals)
        wire.say(op="send_action_goal", action="/count", action_type=FIBONACCI, args={"order": 1}, id="g")
        assert len(self.goals) - before == (not self.model.is_stopped)

    @rule(wire=wires, value=st.integers(1, 9))
    def set_parameter(self, wire: Wire, value: int) -> None:
        before = self.robot.node.parameters.get("limit")
        wire.ask("/rosapi/set_param", {"name": "/robot:limit", "value": f"{value}.0"})
        expected = before if self.model.is_stopped else float(value)
        assert self.robot.node.parameters.get("limit") == expected

    # Leases

    @rule(wire=wires)
    def take_lease(self, wire: Wire) -> None:
        before = self.model.holder
        self.robot.take()
        answer = wire.ask("/gate/take_lease", {"topic": "/cmd_vel"})
        assert answer is not None
        assert answer["success"] is (not self.model.is_stopped and self.model.may_take(wire.person)), answer
        if answer["success"]:
            self.model.give(wire.person)
            if not self._end_request(wire):
                self._learn_name(wire)
            if before not in (None, wire.person):
                self._require_stop()

    @rule(wire=wires)
    def release_lease(self, wire: Wire) -> None:
        self.robot.take()
        answer = wire.ask("/gate/release_lease", {"topic": "/cmd_vel"})
        assert answer is not None
        assert answer["success"] is (wire.person is self.model.holder)
        if self.model.lose(wire.person):
            self._require_stop()

    @rule(wire=wires, other=wires)
    def pass_lease(self, wire: Wire, other: Wire) -> None:
        if not other.person.name or isinstance(other, HttpWire):
            return
        self.robot.take()
        answer = wire.ask("/gate/pass_lease", {"topic": "/cmd_vel", "to": other.person.name})
        assert answer is not None
        assert answer["success"] is (wire.person is self.model.holder), answer
        if answer["success"]:
            self.model.give(other.person)
            if other is not wire:
                self._require_stop()

    # The emergency stop, the settings and time

    @rule(wire=wires)
    def stop(self, wire: Wire) -> None:
        self.robot.take()
        answer = wire.ask("/gate/stop", {"reason": "test"})
        assert answer is not None
        assert answer["success"]
        if self.model.stop():
            self._require_stop()

    @rule(wire=wires)
    def release_stop(self, wire: Wire) -> None:
        answer = wire.ask("/gate/release_stop", {"reason": "test"})
        assert answer is not None
        assert answer["success"]
        self.model.is_stopped = False

    @rule(limit=st.sampled_from(LIMITS))
    def reload(self, limit: float) -> None:
        self._reload(settings_of(self._gate(limit)))
        self.model.limit = limit

    def _reload(self, changed: Settings) -> None:
        self.robot.access.reload(changed)
        gateways: tuple[Gateway, ...] = (self.robot.bridge, self.bridges["bson"], self.foxglove, self.http)
        for gateway in gateways:
            gateway.reload_roles()

    @rule(milliseconds=st.sampled_from([1, 100, 449, 450, 451, 700, 950, 1000, 1500]))
    def wait(self, milliseconds: int) -> None:
        zeros = 0
        # In whole steps: the clock counts nanoseconds, and the model does not round.
        for _ in range(milliseconds):
            self.robot.take()
            self.robot.clock.advance(0.001)
            if self.model.advance(self._now()):
                self._require_stop()
            assert set(self.robot.heard) <= {(0.0, GATE)}, "nobody published, but the robot was told to move"
            zeros += len(self.robot.heard)
        if self.model.is_stopped:
            assert zeros >= milliseconds // 100 - 1, "the stop message is repeated"

    @rule(seconds=st.sampled_from([0.3, 0.6, 2.0]))
    def pause(self, seconds: float) -> None:
        """The process is stopped, and no timer runs."""
        self.robot.take()
        self.robot.clock.suspend(seconds)
        self.robot.clock.advance(0.0)
        if self.model.advance(self._now()):
            self._require_stop()

    @rule(days=st.sampled_from([-1, 1]))
    def set_wall_clock(self, days: int) -> None:
        """Jump; this has no effect."""
        assert isinstance(self.robot.clock, JumpingClock)
        self.robot.clock.ahead_ns += days * 86_400 * 10**9

    @invariant()
    def both_name_the_same_holder(self) -> None:
        holders = [topic.lease.holder for topic in self.robot.gate.topics if topic.lease]
        name = self.model.holder.name if self.model.holder else None
        assert [each.name if each else None for each in holders] == [name] or not holders

    def teardown(self) -> None:
        if hasattr(self, "foxglove"):
            self.foxglove.close()


TestGateModel = GateMachine.TestCase
TestGateModel.settings = settings(max_examples=EXAMPLES, stateful_step_count=60, deadline=None)
