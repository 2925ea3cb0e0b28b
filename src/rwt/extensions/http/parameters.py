"""Parameters as resources, through rosapi's services and their rules."""

from __future__ import annotations

import json
from typing import Any, Final

import msgspec

from rwt.access.graph_view import GraphView
from rwt.extensions.http.calls import HttpCall
from rwt.extensions.http.clients import Clients
from rwt.extensions.http.problems import HttpProblem
from rwt.extensions.http.representations import value_response
from rwt.extensions.http.requests import Query, text_below, value_of
from rwt.extensions.http.services import ServicePages
from rwt_interfaces.payload import Payload
from rwt_participant.errors import ServiceFailed
from rwt_transports.http.routes import HttpRequest, HttpResponse

PATH: Final = "/api/parameters/"

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
        name = _name(request)
        answer = await self._ask(request, reader, "get_param", {"name": name})
        if getattr(answer, "successful", True) and answer.value != "null":
            return value_response(request, json.loads(answer.value))
        raise HttpProblem("not-found", getattr(answer, "reason", "") or f"parameter {name} is not set")

    async def set(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Set a parameter to the body."""
        Query(request)
        name = _name(request)
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
        name = _name(request)
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


def _name(request: HttpRequest) -> str:
    return "/" + text_below(request.path, PATH, "parameter")
