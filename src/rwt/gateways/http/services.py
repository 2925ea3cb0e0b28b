"""Services as resources: types and calls; and parameters, through rosapi's services and their rules."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import msgspec

from rwt.gateways.http.calls import PATH, HttpCall, KeptTable, notice_headers, preferred_wait
from rwt.gateways.http.problems import CallWaits, HttpProblem
from rwt.gateways.http.representations import payload_response, value_response
from rwt.gateways.http.requests import Query, name_and_type, name_below, payload_of, text_below, value_of
from rwt_interfaces.payload import Payload
from rwt_participant.errors import ProviderNotFound, ServiceFailed
from rwt_participant.spelling import did_you_mean
from rwt_transports.http.routes import HttpResponse

if TYPE_CHECKING:
    from collections.abc import Awaitable

    from rwt.access.graph_view import GraphView
    from rwt.gateways.http.clients import Clients
    from rwt.gateways.http.settings import HttpSettings
    from rwt_transports.http.routes import HttpRequest


_CALL: Final = re.compile(r"/calls/([0-9a-f]{32})\Z")

CALL_SECONDS: Final = 10.0
"""Default timeout of a call, in seconds."""


class ServicePages:
    """Routes of services."""

    def __init__(self, clients: Clients, settings: HttpSettings) -> None:
        self._clients = clients
        self._settings = settings
        self.calls: KeptTable[HttpCall] = KeptTable(settings, "calls of this client wait")

    def list(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """List the visible services with their types."""
        Query(request)
        return value_response(request, [name_and_type(reader, each) for each in reader.services()])

    def get(self, request: HttpRequest, reader: GraphView) -> HttpResponse | Awaitable[HttpResponse]:
        """Return the type of a service, or a call of it that required approval."""
        found = _CALL.search(request.path.rstrip("/"))
        if found is not None:
            return self._call(request, reader, found)
        Query(request)
        name = name_below(request, PATH, "service")
        service = reader.service(name)
        if service is None:
            meant = did_you_mean(name, (each.name for each in reader.services()))
            raise HttpProblem("not-found", f"no service {name} is here{meant}")
        return value_response(request, name_and_type(reader, service))

    async def call(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Call a service with the body as its request, and return its response."""
        name = name_below(request, PATH, "service")
        longest = self._settings.wait_seconds
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
        await call.wait(preferred_wait(request, self._settings.wait_seconds))
        if call.outcome is None:
            self.calls.make_room(call.client)
            call.on_end = partial(self._end, call)
            self.calls.add(call)
            raise CallWaits(call.state(request))
        return call.response()

    def _end(self, call: HttpCall) -> None:
        call.keep_outcome()
        self.calls.end(call)

    async def _call(self, request: HttpRequest, reader: GraphView, found: re.Match[str]) -> HttpResponse:
        """Return the outcome of a call that required approval, or its state."""
        Query(request)
        name = name_below(replace(request, path=request.path[: found.start()]), PATH, "service")
        with self._clients.client_of(request, reader) as client:
            client.graph.require("call", name)
            call = self.calls.get(found[1])
            if call is None or call.client is not client or call.service != name:
                raise HttpProblem(
                    "not-found", f"no call {found[1]} of {name} by this client is known here; those that have"
                    f" ended are kept for {self.calls.seconds:g} s", instead="call again with POST",
                )  # fmt: skip
            await call.wait(preferred_wait(request, self._settings.wait_seconds))
            if call.outcome is None:
                return call.state(request)
            return payload_response(request, call.response(), notice_headers(call.notices))


PARAMETERS_PATH: Final = "/api/parameters/"

ANSWER_SECONDS: Final = 10.0
"""Timeout of a node's parameter services, in seconds."""


class ParameterPages:
    """Routes of parameters: ``/node:name`` on ROS 2, ``/name`` on ROS 1."""

    def __init__(self, clients: Clients, services: ServicePages) -> None:
        self._clients = clients
        self._services = services

    async def list(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """List the names of the visible parameters."""
        Query(request)
        answer = await self._ask(request, reader, "get_param_names", {})
        return value_response(request, list(answer.names))

    async def get(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Return the value of a parameter."""
        Query(request)
        name = _parameter_name(request)
        answer = await self._ask(request, reader, "get_param", {"name": name})
        if getattr(answer, "successful", True) and answer.value != "null":
            return value_response(request, json.loads(answer.value))
        raise HttpProblem("not-found", getattr(answer, "reason", "") or f"parameter {name} is not set")

    async def set(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Set a parameter to the body."""
        Query(request)
        name = _parameter_name(request)
        value = value_of(request)
        if value is None:
            raise HttpProblem(
                "parameter-rejected", "null is no value", instead="DELETE removes the parameter"
            )
        try:
            text = msgspec.json.encode(value).decode()
        except (TypeError, ValueError, RecursionError) as error:
            raise HttpProblem("parameter-rejected", f"not a value of a parameter: {error}") from None
        return await self._change(request, reader, "set_param", {"name": name, "value": text})

    async def delete(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Delete a parameter."""
        Query(request)
        name = _parameter_name(request)
        has = await self._ask(request, reader, "has_param", {"name": name})
        if not has.exists:
            raise HttpProblem("not-found", f"parameter {name} is not set")
        return await self._change(request, reader, "delete_param", {"name": name})

    async def _change(
        self, request: HttpRequest, reader: GraphView, service: str, values: dict[str, str]
    ) -> HttpResponse:
        try:
            answer = await self._ask(request, reader, service, values)
        except ServiceFailed as failed:  # ROS 1's rosapi reports a missing parameter this way.
            raise HttpProblem("parameter-rejected", str(failed)) from None
        if not getattr(answer, "successful", True):
            raise HttpProblem("parameter-rejected", answer.reason)
        return HttpResponse(status=204)

    async def _ask(self, request: HttpRequest, reader: GraphView, service: str, values: object) -> Any:
        with self._clients.client_of(request, reader) as client:
            name, graph = f"/rosapi/{service}", client.graph
            graph.require("call", name)
            found = graph.service(name)
            if found is None:
                raise HttpProblem(
                    "not-found", "parameters are read and set through rosapi, which is not here",
                    instead="let the node rosapi take part (the setting `nodes`)",
                )  # fmt: skip
            call = HttpCall(client, name)
            call.send(Payload.from_value(found.type.request, values), ANSWER_SECONDS)
            return (await self._services.response(request, call)).value()


def _parameter_name(request: HttpRequest) -> str:
    return "/" + text_below(request, PARAMETERS_PATH, "parameter")
