"""call_service, service_response, advertise_service, unadvertise_service: the services of one client."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, Never

from rwt.access.client_graph import ClientGraph
from rwt.rosbridge.ops.offers import Offers, PeerOffers, Provided
from rwt.rosbridge.ops.payloads import (
    IN_STEPS,
    arguments_in_steps,
    arguments_of,
    checked_values,
    failure_text,
    now_or_in_steps,
    object_or_empty,
)
from rwt.rosbridge.reply import Replies
from rwt_graph.api import ServiceCall
from rwt_graph.names import resolve
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ServiceType
from rwt_participant.errors import CallFailed, ProviderNotFound
from rwt_protocol.dispatcher import Steps
from rwt_protocol.errors import Refused
from rwt_protocol.ops import (
    AdvertiseService,
    CallService,
    Op,
    ServiceResponse,
    UnadvertiseService,
)
from rwt_protocol.payloads import Encodable, RawJson


def split_suffix(name: str) -> tuple[str, str | None]:
    """Take the legacy ``#id`` off a service's or an action's name (SRV-09, ACT-11)."""
    base, hash_, suffix = name.partition("#")
    return (base, suffix) if hash_ else (name, None)


#: Paths of arguments and responses in their ops, for errors.
_ARGUMENTS: Final = "call_service.args"
_ANSWER: Final = "service_response.values"

Asked = tuple["ServiceType", "ServiceCall"]


class _ProvidedService(Provided[Asked]):
    """Service that a client offers, with its pending calls."""

    __slots__ = ()

    def ask(self, type: ServiceType, call: ServiceCall) -> None:
        """Send a request to the client, under a new id (SVP-01, SVP-02)."""
        id_ = self._add("service_request", (type, call))
        call.on_end = lambda: self._end(id_)
        frame = self._replies.session.call(self._name, call.request, id_)
        reason = self._replies.send_frame(frame, id_)
        if reason is not None:
            call.fail(f"the provider cannot be asked: {reason}")


class PeerServices:
    """Services that one client calls and provides. Calls end after `timeout` seconds (SRV-10); 0: never."""

    __slots__ = ("_address", "_graph", "_now", "_replies", "_timeout", "provided")

    def __init__(
        self, graph: ClientGraph, replies: Replies, address: str, offers: Offers[Asked], timeout: float
    ) -> None:
        self._graph = graph
        self._replies = replies
        self._address = address
        self._timeout = timeout
        self._now = graph.clock.time_ns
        # The services themselves are withdrawn by the client's graph (DIS-04).
        self.provided = PeerOffers(graph, address, offers)

    def call(self, op: CallService, checked: Payload | None = None) -> Steps | None:
        """Call a service of the graph and answer with the caller's id (SRV-01 … SRV-14); large arguments are
        checked in steps.

        Args:
            checked: the request, if the arguments have been checked in steps.
        """
        args = op.args
        size = len(args.data) if isinstance(args, RawJson) else args.size
        if size >= IN_STEPS and checked is None:
            return self._call_in_steps(op)
        name, replies, fragment_size = op.service, self._replies, op.fragment_size
        service, suffix = split_suffix(name) if "#" in name else (name, None)
        mark = suffix if op.id is None else op.id
        seconds = self._timeout if op.timeout is None else op.timeout

        def on_reply(outcome: Payload | CallFailed) -> None:
            """Answer the client: exactly one reply per call (SRV-14)."""
            reason: str | None
            if isinstance(outcome, CallFailed):
                reason = str(outcome)
            else:
                frame = replies.session.response(name, outcome, mark)
                reason = replies.send_frame(frame, mark, fragment_size)
            if reason is not None:
                replies.send(ServiceResponse(service=name, values=reason, result=False, id=mark))

        try:
            request_of = partial(arguments_of, raw=args, where=_ARGUMENTS, now=self._now, checked=checked)
            self._graph.call_service(service, request_of, on_reply, seconds if seconds > 0 else None)
        except ProviderNotFound as missing:
            raise Refused(str(missing)) from None
        return None

    def _call_in_steps(self, op: CallService) -> Steps:
        service = self._graph.service(split_suffix(op.service)[0])
        request: Payload | None = None
        if service is not None:
            request = yield from arguments_in_steps(service.type.request, op.args, _ARGUMENTS, self._now)
        self.call(op, request)

    def advertise(self, op: AdvertiseService) -> None:
        """Offer a service on the client's behalf, in place of any other of that name (SVP-01, SVP-07)."""
        provided = _ProvidedService(op.service, self._graph, self._address, self._replies)
        self._graph.advertise_service(op.service, op.type, provided.ask)
        self.provided.add(provided)

    def unadvertise(self, op: UnadvertiseService) -> None:
        """Withdraw a service of this client; its waiting calls fail (SVP-08 … SVP-10)."""
        if not self._graph.withdraw_service(op.service):
            raise Refused(
                f"unadvertise_service: this client does not advertise {op.service}", level="warning"
            )
        self.provided.discard(resolve(op.service))

    def answer(self, op: ServiceResponse) -> Steps | None:
        """Pass a provider's response to the caller (SVP-03 … SVP-08); a large one is checked in steps.

        Only the provider may respond, also over another connection.
        """
        if not op.result:
            _, call = self._asked(op.service, op.id)
            call.fail(failure_text(op.values, "the service failed and gave no reason"))
            return None
        values = object_or_empty(op.values)
        return now_or_in_steps(values, self._reply(op, values))

    def _reply(self, op: ServiceResponse, values: Encodable) -> Steps:
        # The call stays pending meanwhile, so that it ends with its provider or its timeout.
        type, _ = self._pending(op.service, op.id)[str(op.id)]
        try:
            response = yield from checked_values(type.response, values, _ANSWER, self._now)
        except Refused as refused:
            _, call = self._asked(op.service, op.id)
            call.fail(f"the provider's answer does not fit {type.name}: {refused.reason}")
            raise
        _, call = self._asked(op.service, op.id)
        call.reply(response)

    def answer_malformed(self, service: str, id: str | int | None, reason: str) -> None:
        """End the call of an invalid response, so that its caller does not wait forever."""
        _, call = self._asked(service, id)
        call.fail(f"the provider's answer is malformed: {reason}")

    def _asked(self, service: str, id: str | int | None) -> Asked:
        return self._pending(service, id).pop(str(id))

    def _pending(self, service: str, id: str | int | None) -> dict[str, Asked]:
        return self.provided.pending("service_response", service, id, f"no call of {service} waits")


HANDLERS: Final[Mapping[type[Op], Callable[[PeerServices, Never], Steps | None]]] = {
    CallService: PeerServices.call,
    ServiceResponse: PeerServices.answer,
    AdvertiseService: PeerServices.advertise,
    UnadvertiseService: PeerServices.unadvertise,
}
