"""Services as resources: their types, and calls."""

from __future__ import annotations

import re
from collections.abc import Awaitable
from contextlib import suppress
from functools import partial
from typing import Final

from rwt.access.graph_view import GraphView
from rwt.extensions.http.calls import PATH, HttpCall, KeptTable, notice_headers, preferred_wait
from rwt.extensions.http.clients import Clients
from rwt.extensions.http.problems import CallWaits, HttpProblem
from rwt.extensions.http.representations import payload_response, value_response
from rwt.extensions.http.requests import MAX_WAIT_SECONDS, Query, name_and_type, name_below, payload_of
from rwt_interfaces.payload import Payload
from rwt_participant.errors import ProviderNotFound
from rwt_participant.spelling import did_you_mean
from rwt_transports.http.routes import HttpRequest, HttpResponse
from rwt_transports.shared_pool import PoolFull

_CALL: Final = re.compile(r"/calls/([0-9a-f]{32})\Z")

CALL_SECONDS: Final = 10.0
"""Default timeout of a call, in seconds."""


class ServicePages:
    """Routes of services."""

    def __init__(self, clients: Clients, kept: int) -> None:
        self._clients = clients
        self.calls: KeptTable[HttpCall] = KeptTable(kept, "calls of this client wait")

    def get(self, request: HttpRequest, reader: GraphView) -> HttpResponse | Awaitable[HttpResponse]:
        """Return the type of a service, or a call of it that required approval."""
        found = _CALL.search(request.path.rstrip("/"))
        if found is not None:
            return self._call(request, reader, found)
        Query(request)
        name = name_below(request.path, PATH, "service")
        service = reader.service(name)
        if service is None:
            meant = did_you_mean(name, (each.name for each in reader.services()))
            raise HttpProblem("not-found", f"no service {name} is here{meant}")
        return value_response(request, name_and_type(reader, service))

    async def call(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Call a service with the body as its request, and return its response."""
        name = name_below(request.path, PATH, "service")
        longest = MAX_WAIT_SECONDS
        seconds = Query(request, ("timeout",)).seconds("timeout", min(CALL_SECONDS, longest), longest)
        with self._clients.client_of(request, reader) as client:
            graph = client.graph
            graph.require("call", name)
            service = graph.service(name)
            if service is None:
                raise ProviderNotFound(f"no service {name} is here")
            payload = await payload_of(service.type.request, request, graph.clock.time_ns)
            call = HttpCall(client, name)
            call.send(payload, seconds)
            response = await self.response(request, call)
            return payload_response(request, response, notice_headers(call.notices))

    async def response(self, request: HttpRequest, call: HttpCall) -> Payload:
        """Return the response of a call that was sent.

        Raises:
            CallWaits: it waits for approval, longer than the request prefers to wait.
            CallFailed: it has failed.
        """
        await self._wait(request, call)
        if call.outcome is None:
            self.calls.make_room(call.client)
            call.on_end = partial(self._end, call)
            self.calls.add(call)
            raise CallWaits(call.state(request))
        return call.response()

    async def _wait(self, request: HttpRequest, call: HttpCall) -> None:
        """Wait for the outcome; if approval is required, for as long as the client prefers and there is room.

        The call itself continues in any case.
        """
        seconds = preferred_wait(request, MAX_WAIT_SECONDS)
        if seconds and call.outcome is None and call.approval is not None:
            with suppress(PoolFull), self._clients.waiting(call.client):
                await call.wait(seconds)
        if call.outcome is None and call.approval is None:
            await call.wait(0.0)

    def _end(self, call: HttpCall) -> None:
        call.keep_outcome()
        self.calls.end(call)

    async def _call(self, request: HttpRequest, reader: GraphView, found: re.Match[str]) -> HttpResponse:
        """Return the outcome of a call that required approval, or its state."""
        Query(request)
        name = name_below(request.path[: found.start()], PATH, "service")
        with self._clients.client_of(request, reader) as client:
            client.graph.require("call", name)
            call = self.calls.get(found[1])
            if call is None or call.client is not client or call.service != name:
                raise HttpProblem(
                    "not-found", f"no call {found[1]} of {name} by this client is known here; those that have"
                    f" ended are kept for {self.calls.seconds:g} s", instead="call again with POST",
                )  # fmt: skip
            await self._wait(request, call)
            if call.outcome is None:
                return call.state(request)
            return payload_response(request, call.response(), notice_headers(call.notices))
