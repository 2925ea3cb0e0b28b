"""The gate's own topics and services: who holds what, what waits for a yes, and the stop."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, Protocol, cast

from rwt.access.errors import GateRefused
from rwt.access.gate.record import CALLER
from rwt.access.graph_view import canonical
from rwt_interfaces.payload import Payload
from rwt_participant.qos import LATCHED

if TYPE_CHECKING:
    from rwt.access.gate.gate import Gate
    from rwt.access.gate.record import Actor
    from rwt_graph.api import Graph, Publisher, Sample, ServiceCall
    from rwt_interfaces.structs import ServiceType

logger: Final = logging.getLogger("rwt.bridge")

LEASES: Final = "/gate/leases"
STOPPED: Final = "/gate/stopped"
APPROVALS: Final = "/gate/approvals"
TOPICS: Final = frozenset({LEASES, STOPPED, APPROVALS})
"""What the gate tells: latched topics, on which clients do not publish."""

STOP_TOPIC: Final = "/gate/stop"
"""A message here, an empty one, is a press of the emergency stop."""

SERVICES: Final = {
    "/gate/take_lease": "rwt_gate_msgs/Lease",
    "/gate/release_lease": "rwt_gate_msgs/Lease",
    "/gate/pass_lease": "rwt_gate_msgs/PassLease",
    "/gate/stop": "rwt_gate_msgs/Stop",
    "/gate/release_stop": "rwt_gate_msgs/Stop",
    "/gate/approve": "rwt_gate_msgs/Approve",
}
"""The gate's services with their types. They need no right to `call`: the gate's own settings decide."""


class GateNode:
    """Serves what :data:`SERVICES` names, and publishes what has changed.

    Args:
        gate: see there.
        graph: the robot.
    """

    def __init__(self, gate: Gate, graph: Graph) -> None:
        self._gate = gate
        self._clock = graph.clock
        self._distro = graph.distro
        self._registry = graph.registry
        self._due: set[str] = set()
        participant = gate.participant
        self._publishers: dict[str, Publisher] = {
            name: participant.advertise(name, graph.registry.message(type), LATCHED)
            for name, type in (
                (LEASES, "rwt_gate_msgs/Leases"),
                (STOPPED, "rwt_gate_msgs/EmergencyStop"),
                (APPROVALS, "rwt_gate_msgs/Approvals"),
            )
        }
        handlers: dict[str, Callable[[Actor | None, _Request], dict[str, object]]] = {
            "/gate/take_lease": self._take_lease,
            "/gate/release_lease": self._release_lease,
            "/gate/pass_lease": self._pass_lease,
            "/gate/stop": self._stop,
            "/gate/release_stop": self._release_stop,
            "/gate/approve": self._approve,
        }
        for name, handler in handlers.items():
            type = graph.registry.service(SERVICES[name])
            participant.advertise_service(name, type, _answering(type, handler))
        participant.subscribe(STOP_TOPIC, self._on_stop, graph.registry.message("std_msgs/Empty"))
        gate.on_leases = lambda: self._tell_soon(LEASES)
        gate.on_stop = lambda: self._tell_soon(STOPPED)
        gate.on_approvals = lambda: self._tell_soon(APPROVALS)
        for name in sorted(TOPICS):
            self._tell(name)

    def _tell_soon(self, name: str) -> None:
        """Publish in the clock's next turn: of many changes at once, the outcome."""
        if name not in self._due:
            self._due.add(name)
            self._clock.call_later(0.0, lambda: self._tell(name))

    def _tell(self, name: str) -> None:
        self._due.discard(name)
        publisher = self._publishers[name]
        tell = {LEASES: self._leases, STOPPED: self._stopped, APPROVALS: self._approvals}[name]
        publisher.publish(Payload.from_value(publisher.type, tell()))

    def _leases(self) -> dict[str, object]:
        time = self._distro.time
        return {
            "leases": [
                {
                    "topic": topic.name,
                    "rule": topic.lease_rule,
                    "holder": topic.lease.holder.name if topic.lease.holder else "",
                    "role": topic.lease.holder.role if topic.lease.holder else "",
                    "since": time(topic.lease.since_ns),
                    "seconds": topic.lease.settings.seconds,
                }
                for topic in self._gate.topics
                if topic.lease is not None
            ]
        }

    def _stopped(self) -> dict[str, object]:
        gate = self._gate
        return {
            "stopped": bool(gate.stopped_by),
            "by": gate.last_by,
            "reason": gate.stopped_reason,
            "since": self._distro.time(gate.stopped_ns),
        }

    def _approvals(self) -> dict[str, object]:
        waiting = []
        for each in self._gate.approvals.pending:
            settings = each.rule.settings.approval
            assert settings is not None  # Only rules with it ask.
            waiting.append(
                {
                    "id": each.id,
                    "act": each.act,
                    "name": each.name,
                    "rule": each.rule.key,
                    "client": each.client.name,
                    "role": each.client.role,
                    "content": each.content,
                    "asked": self._distro.time(each.asked_ns),
                    "seconds": settings.seconds,
                    "remember_seconds": settings.remember_seconds,
                }
            )
        return {"approvals": waiting}

    def _on_stop(self, sample: Sample) -> None:
        try:
            self._gate.stop(None, f"by a message of {sample.node or 'another process'} on {STOP_TOPIC}")
        except GateRefused as refused:
            logger.error("gate: %s", refused)

    # Services

    def _take_lease(self, actor: Actor | None, request: _Request) -> dict[str, object]:
        return self._about_lease(actor, request("topic"), self._gate.take_lease)

    def _release_lease(self, actor: Actor | None, request: _Request) -> dict[str, object]:
        return self._about_lease(actor, request("topic"), self._gate.release_lease)

    def _about_lease(
        self, actor: Actor | None, topic: str, change: Callable[[Actor, str], None]
    ) -> dict[str, object]:
        """Change who holds a lease, and say who does then; it is said to those who are refused, too."""
        client, refusal = _client(actor), ""
        try:
            change(client, topic)
        except GateRefused as refused:
            refusal = str(refused)
        held = [
            each.lease.holder for each in self._gate.topics if each.lease and each.name == canonical(topic)
        ]
        holder = held[0].name if held and held[0] else ""
        may = client.rights.allows("publish", canonical(topic))
        seconds = self._gate.lease_seconds(client.rights, topic) if may else None
        return {
            "success": not refusal,
            "message": refusal,
            "client": client.name,
            "holder": holder,
            "seconds": seconds or 0.0,
        }

    def _pass_lease(self, actor: Actor | None, request: _Request) -> dict[str, object]:
        to = request("to")
        self._gate.pass_lease(_client(actor), request("topic"), to)
        return {"success": True, "message": f"{to} holds it now"}

    def _stop(self, actor: Actor | None, request: _Request) -> dict[str, object]:
        self._gate.stop(actor, request("reason"))
        return {"success": True, "message": "stopped; nothing moves the robot until it is released"}

    def _release_stop(self, actor: Actor | None, request: _Request) -> dict[str, object]:
        self._gate.release(actor, request("reason"))
        return {"success": True, "message": "released"}

    def _approve(self, actor: Actor | None, request: _Request) -> dict[str, object]:
        value = cast(_Fields, request.value)
        what = self._gate.approvals.answer(
            value.id,
            approve=value.approve,
            by=actor,
            seconds=value.seconds,
        )
        return {"success": True, "message": what}


class _Fields(Protocol):
    id: str
    approve: bool
    seconds: float


class _Request:
    """The request of a call, by its fields."""

    def __init__(self, payload: Payload) -> None:
        self.value = payload.value()

    def __call__(self, field: str) -> str:
        return str(getattr(self.value, field))


def _client(actor: Actor | None) -> Actor:
    if actor is None:
        raise GateRefused("leases are for clients: programs of the robot publish without")
    return actor


def _answering(
    type: ServiceType, handler: Callable[[Actor | None, _Request], dict[str, object]]
) -> Callable[[ServiceCall], None]:
    """Answers calls by a handler; what the gate refuses is an answer too."""

    def on_call(call: ServiceCall) -> None:
        actor = CALLER.get()
        # What a yes sets off is not done by who says it.
        CALLER.set(None)
        try:
            answer = handler(actor, _Request(call.request))
        except GateRefused as refused:
            answer = {"success": False, "message": str(refused)}
        call.reply(Payload.from_value(type.response, answer))

    return on_call
