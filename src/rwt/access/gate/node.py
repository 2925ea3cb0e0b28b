"""Topics and services of the gate: leases, approvals and the emergency stop."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, Final

from rwt.access.errors import GateRefused
from rwt.access.gate.record import CALLER, Actor
from rwt.access.graph_view import STOP, canonical
from rwt_interfaces.payload import Payload
from rwt_participant.qos import LATCHED

if TYPE_CHECKING:
    from rwt.access.gate.gate import Gate
    from rwt_graph.api import Graph, Publisher, Sample, ServiceCall
    from rwt_interfaces.structs import ServiceType
    from rwt_participant.timers import Timer

logger: Final = logging.getLogger("rwt.bridge")

LEASES: Final = "/gate/leases"
STOPPED: Final = "/gate/stopped"
APPROVALS: Final = "/gate/approvals"
TOPICS: Final = frozenset({LEASES, STOPPED, APPROVALS})
"""Latched topics on which the gate publishes its state; clients cannot publish on them."""

MAX_LISTED: Final = 256
"""Maximum number of leases in a message of :data:`LEASES`; those with a holder come first."""

REQUEST_SECONDS: Final = 30.0
"""Seconds for which a request for a lease is shown to its holder."""

MAX_REQUESTS: Final = 64
MAX_REQUESTS_OF_CREDENTIAL: Final = 8
"""Maximum number of pending requests for leases, and of one credential or address, one for a topic."""

MAX_APPROVALS: Final = 100
"""Maximum number of requests in a message of :data:`APPROVALS`: of many, the oldest of each credential."""

PUBLISH_SECONDS: Final = 0.1
"""Minimum interval between two messages of :data:`LEASES`, or of :data:`APPROVALS`, in seconds."""

#: Maximum number of characters of a name in a request for approval: a call may set many parameters.
_MAX_NAME: Final = 500

SERVICES: Final = {
    "/gate/take_lease": "rwt_gate_msgs/Lease",
    "/gate/release_lease": "rwt_gate_msgs/Lease",
    "/gate/request_lease": "rwt_gate_msgs/Lease",
    "/gate/pass_lease": "rwt_gate_msgs/PassLease",
    STOP: "rwt_gate_msgs/Stop",
    "/gate/release_stop": "rwt_gate_msgs/Stop",
    "/gate/approve": "rwt_gate_msgs/Approve",
}
"""Services of the gate with their types. They require no `call` permission: the gate's settings decide."""


Handler = Callable[["Actor | None", Any], dict[str, object]]
"""Returns the fields of a response, given the client that calls and the request."""


class GateNode:
    """Node of the gate: serves :data:`SERVICES` and publishes :data:`TOPICS`."""

    def __init__(self, gate: Gate, graph: Graph) -> None:
        self._gate = gate
        self._clock = graph.clock
        self._distro = graph.distro
        self._due: set[str] = set()
        self._published_at: dict[str, float] = {}
        #: Clients that ask for a lease, by its topic and their identity, with the end of the request.
        self._requests: dict[tuple[str, str], tuple[Actor, Timer]] = {}
        participant = gate.participant
        self._publishers: dict[str, Publisher] = {
            name: participant.advertise(name, graph.registry.message(type), LATCHED)
            for name, type in (
                (LEASES, "rwt_gate_msgs/Leases"),
                (STOPPED, "rwt_gate_msgs/EmergencyStop"),
                (APPROVALS, "rwt_gate_msgs/Approvals"),
            )
        }
        handlers: dict[str, Handler] = {
            "/gate/take_lease": partial(self._change_lease, gate.take_lease),
            "/gate/release_lease": partial(self._change_lease, gate.release_lease),
            "/gate/request_lease": partial(self._change_lease, self._ask_holder),
            "/gate/pass_lease": self._pass_lease,
            STOP: partial(press, gate),
            "/gate/release_stop": self._release_stop,
            "/gate/approve": self._approve,
        }
        for name, handler in handlers.items():
            type = graph.registry.service(SERVICES[name])
            participant.advertise_service(name, type, _answering(type, handler))
        gate.open_services = SERVICES.keys()
        participant.subscribe(STOP, self._on_stop, graph.registry.message("std_msgs/Empty"))
        gate.on_leases = lambda: self._publish_soon(LEASES, PUBLISH_SECONDS)
        gate.on_stop = lambda: self._publish_soon(STOPPED)
        gate.on_approvals = lambda: self._publish_soon(APPROVALS, PUBLISH_SECONDS)
        for name in sorted(TOPICS):
            self._publish(name)

    def _publish_soon(self, name: str, interval: float = 0.0) -> None:
        """Publish in the next turn of the clock, or `interval` seconds after the last time.

        Several changes are published once, so that clients do not decide how often it is.
        """
        if name in self._due:
            return
        now = self._clock.monotonic()
        self._due.add(name)
        at = max(now, self._published_at.get(name, now - interval) + interval)
        self._published_at[name] = at
        self._clock.call_later(at - now, lambda: self._publish(name))

    def _publish(self, name: str) -> None:
        self._due.discard(name)
        publisher = self._publishers[name]
        state = {LEASES: self._leases, STOPPED: self._stopped, APPROVALS: self._approvals}[name]
        publisher.publish(Payload.from_value(publisher.type, state()))

    def _leases(self) -> dict[str, object]:
        time = self._distro.time
        return {
            "leases": [
                {
                    "topic": topic.name,
                    "rule": topic.lease_rule,
                    **_described("holder", topic.lease.holder),
                    "since": time(topic.lease.since_ns),
                    "seconds": topic.lease.settings.seconds,
                    "requests": self._requests_for(topic.name, topic.lease.holder),
                }
                for topic in islice(self._gate.leased_topics(), MAX_LISTED)
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
        waiting = [
            {
                "id": each.id,
                "act": each.act,
                "name": each.name if len(each.name) <= _MAX_NAME else f"{each.name[:_MAX_NAME]}…",
                "rule": each.rule.key,
                "client": each.client.name,
                "role": each.client.role,
                "content": each.content,
                "asked": self._distro.time(each.asked_ns),
                "seconds": each.settings.seconds,
                "remember_seconds": each.settings.remember_seconds,
            }
            for each in self._gate.approvals.listed(MAX_APPROVALS)
        ]
        return {"approvals": waiting}

    def _on_stop(self, sample: Sample) -> None:
        try:
            self._gate.stop(None, f"by a message of {sample.node or 'another process'} on {STOP}")
        except GateRefused as refused:
            logger.error("gate: %s", refused)

    # Services

    def _ask_holder(self, client: Actor, name: str) -> None:
        """Show the holder of a lease that a client asks for it, until it has it or :data:`REQUEST_SECONDS`.

        Raises:
            GateRefused: no other client holds it, too many requests are pending, or as for `Gate.leased`.
        """
        topic, lease = self._gate.leased(client, name)
        if lease.holder in (None, client):
            raise GateRefused(f"no other client holds the lease of {topic.name}: take it")
        key = topic.name, client.owner
        if key not in self._requests:
            own = sum(owner == client.owner for _, owner in self._requests)
            if own >= MAX_REQUESTS_OF_CREDENTIAL:  # Else one client could keep others from asking.
                raise GateRefused(
                    f"{own} requests of this credential for leases are pending: try again later"
                )
            if len(self._requests) >= MAX_REQUESTS:
                raise GateRefused(f"{MAX_REQUESTS} requests for leases are pending: try again later")
        else:
            self._requests.pop(key)[1].cancel()
        timer = self._clock.call_later(REQUEST_SECONDS, lambda: self._end_request(key))
        self._requests[key] = client, timer
        self._publish_soon(LEASES, PUBLISH_SECONDS)

    def _end_request(self, key: tuple[str, str]) -> None:
        del self._requests[key]
        self._publish_soon(LEASES, PUBLISH_SECONDS)

    def _requests_for(self, topic: str, holder: Actor | None) -> list[dict[str, object]]:
        """Return the pending requests for a lease; drop those that are granted, or whose client has left."""
        for key, (client, timer) in tuple(self._requests.items()):
            if (key[0] == topic and client is holder) or self._gate.actors.get(client.name) is not client:
                timer.cancel()
                del self._requests[key]
        return [
            _described("client", client) for (name, _), (client, _) in self._requests.items() if name == topic
        ]

    def _change_lease(
        self, change: Callable[[Actor, str], None], actor: Actor | None, request: Any
    ) -> dict[str, object]:
        """Change a lease, and return its holder, also if the change was rejected."""
        client, topic, refusal = _client(actor), request.topic, ""
        try:
            change(client, topic)
        except GateRefused as refused:
            refusal = str(refused)
        held = self._gate.holder_of(canonical(topic))
        # As for subscribers of the topic of leases: only roles that may see a topic see who holds it.
        sees = client.rights.sees_topic(canonical(topic))
        holder = held.name if sees and held is not None else ""
        may = client.rights.allows("publish", canonical(topic))
        seconds = self._gate.lease_seconds(client.rights, topic) if may else None
        return {
            "success": not refusal,
            "message": refusal,
            "client": client.name,
            "holder": holder,
            "seconds": seconds or 0.0,
        }

    def _pass_lease(self, actor: Actor | None, request: Any) -> dict[str, object]:
        to = request.to
        self._gate.pass_lease(_client(actor), request.topic, to)
        return {"success": True, "message": f"{to} holds it now"}

    def _release_stop(self, actor: Actor | None, request: Any) -> dict[str, object]:
        self._gate.release(actor, request.reason)
        return {"success": True, "message": "released"}

    def _approve(self, actor: Actor | None, request: Any) -> dict[str, object]:
        what = self._gate.approvals.answer(
            request.id, approve=request.approve, by=actor, seconds=request.seconds
        )
        return {"success": True, "message": what}


def _described(key: str, client: Actor | None) -> dict[str, object]:
    """Return the fields that name a client, by connection and so that people recognise it."""
    if client is None:
        return {key: "", "role": "", "user": "", "device": ""}
    return {key: client.name, "role": client.role, "user": client.credential, "device": client.device}


def press(gate: Gate, actor: Actor | None, request: Any) -> dict[str, object]:
    """Press the emergency stop, and return the fields of the response."""
    undelivered = gate.stop(actor, request.reason)
    if undelivered:
        text = f"clients' commands are rejected until the release, but these were not stopped: {undelivered}"
        return {"success": False, "message": text}
    return {"success": True, "message": "stopped; commands of clients are rejected until it is released"}


def _client(actor: Actor | None) -> Actor:
    if actor is None:
        raise GateRefused("leases are for clients: programs of the robot publish without")
    return actor


def answer_of(type: ServiceType, handler: Handler, actor: Actor | None, request: Payload) -> Payload:
    """Return the response of a handler; a rejection by the gate is an answer, too."""
    try:
        answer = handler(actor, request.value())
    except GateRefused as refused:
        answer = {"success": False, "message": str(refused)}
    return Payload.from_value(type.response, answer)


def _answering(type: ServiceType, handler: Handler) -> Callable[[ServiceCall], None]:
    def on_call(call: ServiceCall) -> None:
        actor = CALLER.get()
        # An approved act is performed for the client that requested it, not for the one that approves.
        CALLER.set(None)
        call.reply(answer_of(type, handler, actor, call.request))

    return on_call
