"""Service calls of one client."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from functools import partial

from msgspec.structs import replace

from rwt.access.client_graph import ClientGraph
from rwt.access.errors import AccessError
from rwt.extensions.foxglove.catalogue import OfferedService
from rwt.extensions.foxglove.errors import FoxgloveError, NotPossible
from rwt.extensions.foxglove.replies import FoxgloveReplies
from rwt.extensions.foxglove.wire.client_messages import ServiceCallRequest
from rwt.extensions.foxglove.wire.payloads import check_encoding, in_encoding, payload_of
from rwt.extensions.foxglove.wire.server_messages import service_call_failure, service_call_response
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import CallFailed, RobotError


class ServiceCalls:
    """Calls of one client; `timeout` is in seconds, None for no timeout."""

    def __init__(
        self, graph: ClientGraph, replies: FoxgloveReplies, structure: int, timeout: float | None
    ) -> None:
        self._graph = graph
        self._replies = replies
        self._structure = structure
        self._timeout = timeout

    def call(self, request: ServiceCallRequest, services: Mapping[int, OfferedService]) -> Generator[None]:
        """Call a service; the response or error is sent under the call's id."""
        try:
            yield from self._call(request, services)
        except (RobotError, AccessError, FoxgloveError) as error:
            self._fail(request, str(error))

    def _call(self, request: ServiceCallRequest, services: Mapping[int, OfferedService]) -> Generator[None]:
        service = services.get(request.service_id)
        if service is None:
            raise NotPossible(f"there is no service {request.service_id}")
        check_encoding(request.encoding, self._graph.distro)
        try:
            made: Payload = yield from payload_of(
                service.type.request,
                request.encoding,
                request.data,
                self._graph.clock.time_ns,
                self._structure,
            )
        except InvalidMessage as error:
            raise NotPossible(f"the request for {service.name}: {error}") from None

        payload = made.detach()  # A copy: the service may keep it longer than the frame exists.

        def request_of(type: MessageType) -> Payload:
            # Compared by identity: the request was built for the class of this type.
            if type is not service.type.request:
                raise NotPossible(f"{service.name} has become another service: see `advertiseServices`")
            return payload

        # Without the request's bytes, which a long call would retain.
        asked = replace(request, data=memoryview(b""))
        on_reply: Callable[[Payload | CallFailed], None] = partial(self._reply, asked)
        self._graph.call_service(service.name, request_of, on_reply, self._timeout)

    def _reply(self, request: ServiceCallRequest, outcome: Payload | CallFailed) -> None:
        if isinstance(outcome, CallFailed):
            self._fail(request, str(outcome))
            return
        try:
            parts = in_encoding(outcome, request.encoding)
        except RobotError as error:  # What another process answered does not fit its type.
            self._fail(request, str(error))
            return
        frame = service_call_response(request.service_id, request.call_id, request.encoding, parts)
        if reason := self._replies.too_large(frame.size):
            # A failure instead, or the client would wait without end.
            self._fail(request, reason)
        else:
            self._replies.send(frame)

    def _fail(self, request: ServiceCallRequest, reason: str) -> None:
        self._graph.counters.refuse("serviceCallRequest")
        self._replies.send(service_call_failure(request.service_id, request.call_id, reason))
