"""call_service, service_response, advertise_service, unadvertise_service."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_access.quotas import require_advertisement, require_call, too_large
from rwt_access.rosapi_filter import narrowed
from rwt_bridge.ops.payloads import arguments_of, failure_text, object_or_empty, payload_of
from rwt_graph.names import resolve
from rwt_program.errors import CallFailed
from rwt_protocol.errors import Refused
from rwt_protocol.ops import ServiceResponse

if TYPE_CHECKING:
    from rwt_access.rosapi_filter import Narrow
    from rwt_bridge.peer import Peer
    from rwt_graph.api import PendingCall, Registration, ServiceCall
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import ServiceType
    from rwt_protocol import ops

#: Answered, abandoned calls are swept out of a provider's table when it has grown to this size.
_SWEEP_AT = 256


class ClientCall:
    """One `call_service` of a client, on its way; called with the outcome."""

    __slots__ = ("_fragment_size", "_id", "_narrow", "_peer", "_service", "pending")

    def __init__(self, peer: Peer, op: ops.CallService, narrow: Narrow | None) -> None:
        self._peer = peer
        self._service = op.service
        self._id = op.id
        self._fragment_size = op.fragment_size
        self._narrow = narrow
        self.pending: PendingCall | None = None

    def __call__(self, outcome: Payload | CallFailed) -> None:
        """Answer the client: exactly one reply per call (SRV-14)."""
        peer = self._peer
        peer.calls.discard(self)
        if isinstance(outcome, CallFailed):
            peer.send(ServiceResponse(service=self._service, values=str(outcome), result=False, id=self._id))
        else:
            if self._narrow is not None:
                outcome = self._narrow(outcome)
            frame = peer.session.response(self._service, outcome, self._id)
            reason = too_large(peer, frame, in_pieces=self._fragment_size is not None)
            if reason is None:
                peer.send_cut(frame, self._fragment_size, self._id)
            else:
                peer.send(ServiceResponse(service=self._service, values=reason, result=False, id=self._id))


def on_call_service(peer: Peer, op: ops.CallService) -> None:
    """Call a service of the graph and answer with the caller's own id (SRV-01 … SRV-14)."""
    service, suffix = split_suffix(op.service)
    if suffix is not None and op.id is None:
        op = op.model_copy(update={"id": suffix})
    name = resolve(service)
    peer.role.require("call", name)
    info = peer.bridge.graph.service(name)
    if info is None:
        raise Refused(f"Service {name} does not exist")
    require_call(peer, op.op)
    request = arguments_of(info.type.request, op.args, "call_service.args", peer.bridge.now)
    call = ClientCall(peer, op, narrowed(peer.role, peer.bridge.graph, name, info.type, request))
    peer.calls.add(call)
    peer.bridge.ledger.calls += 1
    call.pending = peer.bridge.participant.call_service(
        name, request, call, peer.bridge.call_timeout(op.timeout)
    )


def split_suffix(name: str) -> tuple[str, str | None]:
    """Take the legacy ``#id`` off a service's or an action's name (SRV-09, ACT-11)."""
    base, hash_, suffix = name.partition("#")
    return (base, suffix) if hash_ else (name, None)


class ProvidedService:
    """One service that a client offers, and the calls that wait for its answers."""

    def __init__(self, peer: Peer, name: str, type: ServiceType) -> None:
        self._peer = peer
        self._name = name
        self._type = type
        self._count = 0
        self._waiting: dict[str, ServiceCall] = {}
        self._registration: Registration = peer.bridge.participant.advertise_service(
            resolve(name), type, self._forward
        )

    def _forward(self, call: ServiceCall) -> None:
        """Send one request to the client, under an id of its own (SVP-01, SVP-02)."""
        if len(self._waiting) >= _SWEEP_AT:
            self._waiting = {id_: waiting for id_, waiting in self._waiting.items() if not waiting.done}
        self._count += 1
        id_ = f"service_request:{self._name}:{self._count}"
        frame = self._peer.session.call(self._name, call.request, id_)
        reason = too_large(self._peer, frame)
        if reason is not None:
            call.fail(f"the provider cannot be asked: {reason}")
            return
        self._waiting[id_] = call
        self._peer.sink.send(frame)

    def answer(self, op: ops.ServiceResponse) -> None:
        """Hand the client's answer to the caller (SVP-03 … SVP-06)."""
        call = self._waiting.pop(op.id, None) if isinstance(op.id, str) else None
        if call is None:
            raise Refused(
                f"service_response: no call of {self._name} waits under id {op.id!r}", level="warning"
            )
        if not op.result:
            call.fail(failure_text(op.values, "the service failed and gave no reason"))
            return
        try:
            values = object_or_empty(op.values)
            response = payload_of(
                self._type.response, values, "service_response.values", self._peer.bridge.now
            )
        except Refused as refused:
            call.fail(f"the provider's answer does not fit {self._type.name}: {refused.reason}")
            raise
        call.reply(response)

    def close(self) -> None:
        """Withdraw the service; waiting calls fail (SVP-09, SVP-10)."""
        self._registration.close()
        self._waiting.clear()


def on_advertise_service(peer: Peer, op: ops.AdvertiseService) -> None:
    """Offer a service on the client's behalf, in place of any other of that name (SVP-01, SVP-07)."""
    name = resolve(op.service)
    peer.role.require("provide", name)
    service_type = peer.bridge.graph.registry.service(op.type)
    if name not in peer.services:
        require_advertisement(peer, op.op)
    provided = ProvidedService(peer, op.service, service_type)
    previous = peer.services.pop(name, None)
    if previous is not None:
        previous.close()
    peer.services[name] = provided


def on_unadvertise_service(peer: Peer, op: ops.UnadvertiseService) -> None:
    """Withdraw a service of this client (SVP-08, SVP-09)."""
    provided = peer.services.pop(resolve(op.service), None)
    if provided is None:
        raise Refused(f"unadvertise_service: this client does not advertise {op.service}", level="warning")
    provided.close()


def on_service_response(peer: Peer, op: ops.ServiceResponse) -> None:
    """Take a provider's answer; only the client that advertised may give it (SVP-08)."""
    provided = peer.services.get(resolve(op.service))
    if provided is None:
        raise Refused(f"service_response: this client does not advertise {op.service}")
    provided.answer(op)
