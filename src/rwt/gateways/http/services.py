"""Services as resources: what each takes and gives, and calls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import anyio

from rwt.gateways.http.problems import HttpProblem
from rwt.gateways.http.representations import payload_response, value_response
from rwt.gateways.http.requests import Query, name_and_type, name_below, payload_of
from rwt_participant.errors import CallFailed, ProviderNotFound

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rwt.access.client_graph import ClientGraph
    from rwt.access.graph_view import GraphView
    from rwt.gateways.http.clients import Clients
    from rwt.gateways.http.settings import HttpSettings
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import ServiceType
    from rwt_transports.http.routes import HttpRequest, HttpResponse

NOTICE: Final = "Gate-Notice"
"""Header of a response: what the gate did to the request, such as clamping."""

PATH: Final = "/api/services/"

CALL_SECONDS: Final = 10.0
"""Default timeout of a call, in seconds."""


class ServicePages:
    """Routes of services."""

    def __init__(self, clients: Clients, settings: HttpSettings) -> None:
        self._clients = clients
        self._settings = settings

    def list(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """The services that are shown, with their types."""
        Query(request)
        return value_response(request, [name_and_type(reader, each) for each in reader.services()])

    def get(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """One service: its type and who offers it."""
        Query(request)
        name = name_below(request, PATH, "service")
        service = reader.service(name)
        if service is None:
            raise HttpProblem("not-found", f"no service {name} is here")
        return value_response(request, name_and_type(reader, service))

    async def call(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Call a service with the body as its request; the answer is its response."""
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
            notices: list[str] = []
            answer = await call(graph, name, payload, seconds, notices)
            return payload_response(request, answer, notice_headers(notices))


def notice_headers(notices: Sequence[str]) -> Mapping[str, str]:
    """Return the headers that tell what the gate did to a request."""
    return {NOTICE: "; ".join(notices).encode("ascii", "backslashreplace").decode()} if notices else {}


async def call(
    graph: ClientGraph, name: str, payload: Payload, seconds: float, notices: list[str] | None = None
) -> Payload:
    """Call a service and return its response; `notices` gets what the gate did to the request.

    Raises what `ClientGraph.call_service` does, and CallFailed.
    """
    outcomes: list[Payload | CallFailed] = []
    answered = anyio.Event()

    def on_reply(outcome: Payload | CallFailed) -> None:
        outcomes.append(outcome if isinstance(outcome, CallFailed) else outcome.detach())
        answered.set()

    def request_of(type: ServiceType) -> Payload:
        if type.request is not payload.type:
            raise HttpProblem("conflict", f"the type of {name} has changed meanwhile", instead="ask again")
        return payload

    with graph.notices() as found:
        graph.call_service(name, request_of, on_reply, seconds)
    if notices is not None:
        notices += found
    if not outcomes:
        await answered.wait()
    outcome = outcomes[0]
    if isinstance(outcome, CallFailed):
        raise outcome
    return outcome
