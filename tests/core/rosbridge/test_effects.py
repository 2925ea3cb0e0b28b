"""The reference of the ops is true: each member has an effect, but for those that are marked with `NoEffect`.

A scene is played twice, in a server of its own: once as it stands, and once with one member changed.
"""

from __future__ import annotations

import functools
import hashlib
import json
import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from rwt.access.access import Access
from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_protocol.ops import OPS, Direction, Qos
from rwt_protocol.ops.base import NoEffect
from tests.core.rosbridge.recording_client import Client

Step = tuple[str, dict[str, Any]] | float
"""Message of `it`, whose op is tested, or of its `peer`; or seconds that pass."""

NOW = 1_700_000_000
"""Seconds since 1970, for the whole of every scene."""

_SECRET_FILE = Path(__file__).parent / "rosauth_secret.txt"


@dataclass(frozen=True)
class Scene:
    """One op among others.

    Attributes:
        op: the op as it stands.
        changes: another value for members of it, or of its `qos`.
        before, after: what happens around it.
        secret: whether the server wants rosauth's `auth`.
    """

    op: dict[str, Any]
    changes: Mapping[str, Any]
    before: Sequence[Step] = ()
    after: Sequence[Step] = ()
    secret: bool = False

    def play(self, op: dict[str, Any], log: pytest.LogCaptureFixture) -> list[object]:
        """Messages of both clients and of the server's log."""
        log.clear()
        clock = SimulatedClock(start_ns=NOW * 1_000_000_000)
        graph = MemoryGraph(clock=clock)
        auth = {"rosauth_secret_file": _SECRET_FILE} if self.secret else {}
        settings = Settings.model_validate({"auth": auth})
        bridge = Bridge(graph, settings, Access(graph, settings, now=lambda: NOW))
        clients = {"it": Client(bridge), "peer": Client(bridge)}
        for step in (*self.before, ("it", op), *self.after, 10.0):
            if isinstance(step, float):
                clock.advance(step)
            else:
                clients[step[0]].say(**step[1])
        return [
            *(
                (
                    [frame.data for frame, _ in client.frames],
                    [(flow.rules, flow.expiries) for flow in client.flows.values()],
                    client.close_code,
                )
                for client in clients.values()
            ),
            # Ids of goals are random.
            [re.sub(r"\b[0-9a-f]{32}\b", "ID", record.getMessage()) for record in log.records],
        ]


@functools.cache
def _signed() -> dict[str, Any]:
    members: dict[str, Any] = {
        "client": "c", "dest": "d", "rand": "r", "t": NOW, "level": "admin", "end": NOW + 60,
    }  # fmt: skip
    text = _SECRET_FILE.read_text().strip() + "".join(map(str, members.values()))
    return {"op": "auth", "mac": hashlib.sha512(text.encode()).hexdigest(), **members}


def _op(op: str, **members: Any) -> dict[str, Any]:
    return {"op": op, **members}


def _it(op: str, **members: Any) -> Step:
    return "it", _op(op, **members)


def _peer(op: str, **members: Any) -> Step:
    return "peer", _op(op, **members)


TEXT, FIBONACCI, SET_BOOL = "std_msgs/String", "example_interfaces/Fibonacci", "std_srvs/SetBool"
HEARS_ALL = _it("set_level", level="info")
LATE = (2.0, _peer("subscribe", topic="/t", type=TEXT))
"""A subscriber that comes when only latched messages are still there."""
KEPT = (
    _peer("advertise", topic="/t", type=TEXT, qos={"durability": "transient_local", "depth": 5}),
    *(_peer("publish", topic="/t", msg={"data": f"kept {n}, and long enough to be cut"}) for n in range(3)),
)
MORE: list[Step] = [
    step for n in range(5) for step in (_peer("publish", topic="/t", msg={"data": f"more {n}"}), 0.01)
]
CALLED = "service_request:/s:1"
GOAL = "action_goal:/f:1"
RESULT = {"sequence": list(range(30))}
TWO_HALVES = json.dumps(_op("subscribe", topic="/t", type=TEXT))

SCENES: dict[str, Scene] = {
    "advertise": Scene(
        _op("advertise", topic="/t", type=TEXT),
        {"id": "a", "topic": "/u", "type": "std_msgs/Int32", "latch": True, "queue_size": 1,
         "qos": {"durability": "transient_local"}},
        before=[HEARS_ALL],
        after=[_it("publish", topic="/t", msg={"data": "x"}), *LATE],
    ),
    "unadvertise": Scene(
        _op("unadvertise", topic="/t"),
        {"id": "b", "topic": "/u"},
        before=[HEARS_ALL, _it("advertise", topic="/t", type=TEXT, id="a")],
    ),
    "publish": Scene(
        _op("publish", topic="/t", type=TEXT, msg={"data": "x"}),
        {"id": "p", "topic": "/u", "type": "std_msgs/Int32", "msg": {"data": 5}, "latch": True,
         "queue_size": 1, "qos": {"durability": "transient_local"}},
        before=[HEARS_ALL],
        after=[0.1, _it("subscribe", topic="/t", type=TEXT), *LATE],
    ),
    "subscribe": Scene(
        _op("subscribe", topic="/t"),
        {"id": "s", "topic": "/u", "type": "std_msgs/Int32", "throttle_rate": 50, "queue_length": 1,
         "fragment_size": 20, "compression": "cbor", "qos": {"depth": 1}},
        before=[HEARS_ALL, *KEPT],
        after=MORE,
    ),
    "unsubscribe": Scene(
        _op("unsubscribe", topic="/t"),
        {"id": "b", "topic": "/u"},
        before=[HEARS_ALL, _it("subscribe", topic="/t", type=TEXT, id="a")],
        after=MORE,
    ),
    "call_service": Scene(
        _op("call_service", service="/s", args={"data": True}, timeout=50, id="c"),
        {"id": "d", "service": "/u", "type": "std_srvs/Trigger", "args": {"data": False}, "timeout": 1,
         "fragment_size": 20, "compression": "png"},
        before=[_peer("advertise_service", service="/s", type=SET_BOOL)],
        after=[5.0, _peer("service_response", service="/s", id=CALLED, result=True,
                          values={"success": True, "message": "long enough to be cut"})],
    ),
    "service_response": Scene(
        _op("service_response", service="/s", id=CALLED, result=True, values={"success": True}),
        {"id": "x", "service": "/u", "values": {"success": False}, "result": False},
        before=[_it("advertise_service", service="/s", type=SET_BOOL), _peer("call_service", service="/s")],
    ),
    "advertise_service": Scene(
        _op("advertise_service", service="/s", type=SET_BOOL),
        {"id": "a", "service": "/u", "type": "std_srvs/Trigger"},
        before=[HEARS_ALL],
        after=[_peer("call_service", service="/s", args={"data": True})],
    ),
    "unadvertise_service": Scene(
        _op("unadvertise_service", service="/s"),
        {"id": "a", "service": "/u"},
        before=[HEARS_ALL, _it("advertise_service", service="/s", type=SET_BOOL)],
    ),
    "send_action_goal": Scene(
        _op("send_action_goal", action="/f", action_type=FIBONACCI, args={"order": 2}, id="g"),
        {"id": "h", "action": "/u", "action_type": "no_msgs/Nothing", "args": {"order": 3}, "feedback": True,
         "fragment_size": 20, "compression": "png"},
        before=[_peer("advertise_action", action="/f", type=FIBONACCI)],
        after=[_peer("action_feedback", action="/f", id=GOAL, values={"sequence": [0]}),
               _peer("action_result", action="/f", id=GOAL, values=RESULT, status=4, result=True)],
    ),
    "cancel_action_goal": Scene(
        _op("cancel_action_goal", action="/f", id="g"),
        {"id": "h", "action": "/u"},
        before=[_peer("advertise_action", action="/f", type=FIBONACCI),
                _it("send_action_goal", action="/f", action_type=FIBONACCI, id="g")],
    ),
    "action_feedback": Scene(
        _op("action_feedback", action="/f", id=GOAL, values={"sequence": [0]}),
        {"id": "h", "action": "/u", "values": {"sequence": [1]}},
        before=[_it("advertise_action", action="/f", type=FIBONACCI),
                _peer("send_action_goal", action="/f", action_type=FIBONACCI, feedback=True)],
    ),
    "action_result": Scene(
        _op("action_result", action="/f", id=GOAL, values={"sequence": [0]}, status=6, result=True,
            reason="the way is blocked"),
        {"id": "h", "action": "/u", "values": {"sequence": [1]}, "status": 4, "result": False,
         "reason": "the battery is low"},
        before=[_it("advertise_action", action="/f", type=FIBONACCI),
                _peer("send_action_goal", action="/f", action_type=FIBONACCI)],
    ),
    "advertise_action": Scene(
        _op("advertise_action", action="/f", type=FIBONACCI),
        {"id": "a", "action": "/u", "type": "tf2_msgs/LookupTransform"},
        before=[HEARS_ALL],
        after=[_peer("send_action_goal", action="/f", action_type=FIBONACCI, args={"order": 2})],
    ),
    "unadvertise_action": Scene(
        _op("unadvertise_action", action="/f"),
        {"id": "a", "action": "/u"},
        before=[HEARS_ALL, _it("advertise_action", action="/f", type=FIBONACCI)],
    ),
    "set_level": Scene(
        _op("set_level", level="error"),
        {"level": "none"},
        after=[_it("publish", topic="/nobody", msg={})],
    ),
    "set_level, which is refused": Scene(_op("set_level", level="loud"), {"id": "l"}, before=[HEARS_ALL]),
    "fragment": Scene(
        _op("fragment", id="f", num=0, total=2, data=TWO_HALVES[:10]),
        {"id": "e", "num": 1, "total": 3, "data": "?" * 10},
        before=[_it("fragment", id="f", num=1, total=2, data=TWO_HALVES[10:])],
        after=[_peer("advertise", topic="/t", type=TEXT), *MORE],
    ),
    "auth": Scene(
        _signed(),
        {"mac": "0" * 128, "client": "x", "dest": "x", "rand": "x", "t": 1, "level": "x", "end": 1},
        secret=True,
    ),
    "auth, which nobody needs": Scene(_signed(), {"id": "a"}, before=[HEARS_ALL]),
    "subscribe, to a cloud": Scene(
        _op("subscribe", topic="/c"),
        {"compact": {}},
        before=[_peer("advertise", topic="/c", type="sensor_msgs/PointCloud2")],
        after=[_peer("publish", topic="/c", msg={})],
    ),
    "qos of subscribe": Scene(
        _op("subscribe", topic="/t", qos={}),
        {"history": "keep_all", "depth": 1, "reliability": "best_effort", "durability": "volatile",
         "deadline": 1, "lifespan": 1},
        before=KEPT,
        after=MORE,
    ),
}  # fmt: skip
"""By the name of the op; where two scenes are needed, what is special follows."""


@dataclass(frozen=True)
class Change:
    """One member with another value."""

    model: type[BaseModel]
    member: str
    scene: str
    changed: dict[str, Any] = field(compare=False)

    @property
    def is_marked(self) -> bool:
        """True if the reference says that it has no effect."""
        return any(isinstance(item, NoEffect) for item in self.model.model_fields[self.member].metadata)


def _changes() -> list[Change]:
    found = []
    for name, scene in SCENES.items():
        if name == "qos of subscribe":
            found += [
                Change(Qos, policy, name, scene.op | {"qos": {policy: value}})
                for policy, value in scene.changes.items()
            ]
            continue
        model = OPS[name.partition(",")[0]].model
        found += [
            Change(model, member, name, scene.op | {member: value}) for member, value in scene.changes.items()
        ]
    return found


def test_no_member_is_left_out() -> None:
    models: list[type[BaseModel]] = [
        spec.model for spec in OPS.values() if spec.direction is not Direction.TO_CLIENT
    ]
    models.append(Qos)
    known = {(model, name) for model in models for name in model.model_fields if name != "op"}
    assert {(change.model, change.member) for change in _changes()} == known


@pytest.mark.parametrize(
    "change", _changes(), ids=lambda change: f"{change.scene.partition(',')[0]}-{change.member}"
)
def test_a_member_has_an_effect_unless_the_reference_says_that_it_has_none(
    change: Change, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    scene = SCENES[change.scene]
    usual, other = scene.play(scene.op, caplog), scene.play(change.changed, caplog)
    assert (usual == other) is change.is_marked
    assert usual == scene.play(scene.op, caplog)  # The scene itself always goes the same way.
