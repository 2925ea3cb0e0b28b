"""The gateway: its routes, metrics and self-description."""

from __future__ import annotations

import html
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import suppress
from functools import lru_cache, partial
from importlib.resources import files
from typing import Final

import msgspec

from rwt.access.access import Access
from rwt.access.decisions import READS
from rwt.access.graph_view import STOP, GraphView
from rwt.access.settings import LINGER_SECONDS
from rwt.declarations import ALONE, ServerInfo
from rwt.extensions.http import actions, parameters, services, topics
from rwt.extensions.http.clients import Clients, Handler, names_stop, page
from rwt.extensions.http.part import HttpSettings
from rwt.extensions.http.problems import KINDS, REFUSALS, HttpProblem, refusal
from rwt.extensions.http.representations import CBOR, EVENTS, HTML, JSON, chosen, tagged, value_response
from rwt.extensions.http.requests import Query, name_and_type, small_payload_of, text_below
from rwt.gateways.base import Gateway
from rwt.gateways.visitors import url_of
from rwt.observability.build import build_id, version
from rwt_graph.api import ActionInfo, Graph, ServiceInfo, TopicInfo
from rwt_participant.spelling import nearest
from rwt_transports.http.routes import (
    Audience,
    HttpExtension,
    HttpRequest,
    HttpResponse,
    MetricFamily,
    Route,
    StopRequests,
    page_policy,
)

GATEWAY_NODE: Final = "/http_bridge"
"""Absolute name of the node as which all HTTP clients act."""

PROTOCOL_VERSION: Final = "2.1.0"
"""Version of the rosbridge protocol, from its specification."""

SCHEMA_JSON: Final = "application/schema+json"
OPENAPI_JSON: Final = "application/vnd.oai.openapi+json;version=3.1"

_TYPES: Final = "/api/types/"


class HttpGateway(Gateway):
    """HTTP gateway to the robot, as the node `/http_bridge`.

    Args:
        graph: the robot.
        access: access rules of the server.
        settings: settings of the operator.
        linger: seconds that a client stays after its last request, and a publisher after its last client.
        server: names that the description shows, and the number of processes, each of which only knows its
            own goals.
    """

    name = "http"
    verbs = ("publisher", *READS, "send_goal", "cancel_goal")

    def __init__(
        self,
        graph: Graph,
        access: Access,
        settings: HttpSettings,
        linger: float = LINGER_SECONDS,
        server: ServerInfo = ALONE,
    ) -> None:
        super().__init__(graph, access, GATEWAY_NODE, linger)
        self._server = server
        self._requests: dict[tuple[str, str], int] = {}
        self._documents: dict[tuple[str, str], tuple[object, bytes]] = {}
        self._visitors = Clients(self, linger, settings.streams)
        self._actions = actions.ActionPages(
            self._visitors, settings.goals, several_processes=server.processes > 1
        )
        self._services = services.ServicePages(self._visitors, settings.goals)
        self.http = HttpExtension(
            tuple(self._routes(topics.TopicPages(self._visitors, access))), self._section, self._metrics
        )

    def reload_roles(self) -> None:
        """See :meth:`rwt.gateways.base.Gateway.reload_roles`."""
        super().reload_roles()
        self._documents.clear()
        self._visitors.reload_roles()

    def close(self) -> None:
        """Leave the graph."""
        self._actions.goals.close()
        self._services.calls.close()
        self._visitors.close()
        super().close()

    def _routes(self, of_topics: topics.TopicPages) -> Iterable[Route[GraphView]]:
        of_services = self._services
        of_parameters = parameters.ParameterPages(self._visitors, of_services)
        of_actions = self._actions
        rows: tuple[tuple[str, str, str, Handler], ...] = (
            ("GET", "/version", "server", self._version),
            ("GET", "/api", "server", self._api),
            ("GET", "/api/*", "server", _unknown),
            ("GET", "/api/openapi.json", "server", self._openapi),
            ("GET", "/api/types/*", "types", _type),
            ("GET", "/api/topics", "topics", partial(_list, GraphView.topics)),
            ("GET", "/api/topics/*", "topics", of_topics.get),
            ("POST", "/api/topics/*", "topics", of_topics.publish),
            ("GET", "/api/services", "services", partial(_list, GraphView.services)),
            ("GET", "/api/services/*", "services", of_services.get),
            ("POST", "/api/services/*", "services", of_services.call),
            ("GET", "/api/actions", "actions", partial(_list, GraphView.actions)),
            ("GET", "/api/actions/*", "actions", of_actions.get),
            ("POST", "/api/actions/*", "actions", of_actions.send),
            ("DELETE", "/api/actions/*", "actions", of_actions.cancel),
            ("GET", "/api/parameters", "parameters", of_parameters.list),
            ("GET", "/api/parameters/*", "parameters", of_parameters.get),
            ("PUT", "/api/parameters/*", "parameters", of_parameters.set),
            ("DELETE", "/api/parameters/*", "parameters", of_parameters.delete),
        )
        stop = StopRequests(self._may_press, self._press_stop)
        methods: dict[str, list[str]] = {}
        for method, path, _, _ in rows:
            methods.setdefault(path, []).extend((method, "HEAD") if method == "GET" else (method,))
        # Each path has a row for all other methods, so that they are answered with a problem document, too.
        others = tuple(
            (
                "*",
                path,
                "server",
                _unknown if path == "/api/*" else partial(_not_allowed, ", ".join(sorted(known))),
            )
            for path, known in methods.items()
        )
        for method, path, kind, handler in (*rows, *others):
            counted = partial(self._counted, page(handler), (kind, method))
            yield Route(path, counted, Audience.ADMITTED, method, refusal, stop)

    def _may_press(self, request: HttpRequest, reader: GraphView) -> bool:
        return names_stop(request) and self.access.is_stop_due(reader.role)

    def _press_stop(self, request: HttpRequest, reader: GraphView) -> None:
        """Press the emergency stop before the page runs, which takes two turns and reports refusals."""
        with suppress(*REFUSALS), self._visitors.client_of(request, reader) as client:
            graph = client.graph
            read = partial(small_payload_of, request=request, now=graph.clock.time_ns)
            if request.path.startswith(topics.PATH):
                publisher = graph.publisher(STOP, None)
                publisher.publish(read(publisher.type))
            else:
                graph.call_service(STOP, read, lambda response: None)

    def _counted(
        self, handler: Handler, row: tuple[str, str], request: HttpRequest, reader: GraphView
    ) -> HttpResponse | Awaitable[HttpResponse]:
        self._requests[row] = self._requests.get(row, 0) + 1
        return handler(request, reader)

    def _version(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        Query(request)
        body = {
            "name": "robot-web-tools",
            "version": version(),
            "build": build_id(),
            "protocol": "rosbridge",
            "protocol_version": PROTOCOL_VERSION,
            "ros_version": reader.distro.ros_version,
            "distro": reader.distro.name,
            "capabilities": {"http": {"api": f"{request.prefix}/api", "media": [JSON, CBOR, EVENTS]}}
            | {"gateways": list(self._server.gateways), "nodes": list(self._server.nodes)},
        }
        return value_response(request, body)

    def _api(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        if chosen(request, (JSON, CBOR, HTML)) == HTML:
            text, policy = _page()
            return HttpResponse(text, content_type="text/html; charset=utf-8", headers=policy)
        Query(request)
        kinds = ("topics", "services", "actions", "parameters")
        links = {kind: f"{request.prefix}/api/{kind}" for kind in kinds}
        return value_response(request, {**links, "openapi": f"{request.prefix}/api/openapi.json"})

    def _openapi(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Return the OpenAPI document, rebuilt after changes."""
        from rwt.extensions.http import openapi  # Only a few tools and developers read it.

        Query(request)
        media = chosen(request, (JSON, OPENAPI_JSON.partition(";")[0]))
        # By role and prefix: a document lists what the role sees, with URLs below the prefix.
        key = (reader.role.name, request.prefix)
        described = (reader.topics(), reader.services(), reader.actions())
        state = tuple((each.name, each.type) for kind in described for each in kind)
        known = self._documents.get(key)
        if known is None or known[0] != state:
            title = f"A robot that speaks ROS {reader.distro.ros_version} ({reader.distro.name})"
            made = openapi.describe(reader, request.prefix, title)
            if key not in self._documents and len(self._documents) >= _MAX_DOCUMENTS:
                self._documents.clear()
            known = self._documents[key] = (state, msgspec.json.encode(made))
        return tagged(request, known[1], JSON if media == JSON else OPENAPI_JSON)

    def _section(self, request: HttpRequest, reader: GraphView) -> str:
        url = html.escape(url_of(request, "http").rstrip("/"))
        return (
            "<h2>HTTP</h2><pre>"
            f"curl {url}/api/topics                              # what is here\n"
            f"curl -H 'Accept: text/event-stream' {url}/api/topics/TOPIC</pre>"
            '<p><a href="api">Try it in a page</a>, or make a client from'
            ' <a href="api/openapi.json">its OpenAPI document</a>.'
        )

    def _metrics(self) -> Iterable[MetricFamily]:
        yield MetricFamily(
            "rwt_http_requests_total",
            "counter",
            "Requests to the HTTP gateway.",
            [({"resource": kind, "method": method}, n) for (kind, method), n in self._requests.items()],
        )
        yield MetricFamily(
            "rwt_http_streams", "gauge", "Streams of events that are open.", [({}, self._visitors.streams)]
        )
        yield MetricFamily(
            "rwt_http_goals", "gauge", "Goals that can be asked for.", [({}, len(self._actions.goals))]
        )


_MAX_DOCUMENTS: Final = 50
"""Maximum number of cached documents, one for each role and prefix."""


def _unknown(request: HttpRequest, reader: GraphView) -> HttpResponse:
    path = request.path[:200]
    kind, _, rest = path.removeprefix("/api/").partition("/")
    near = nearest(kind, ("topics", "services", "actions", "parameters", "types", "openapi.json"))
    instead = f"/api/{near}" + (f"/{rest}" if rest else "") if near else "/api says what there is"
    raise HttpProblem("not-found", f"there is no {path} here", instead=instead)


def _not_allowed(allowed: str, request: HttpRequest, reader: GraphView) -> HttpResponse:
    raise HttpProblem(
        "method-not-allowed",
        f"{request.method} is not possible for {request.path[:200]}",
        instead=f"use {allowed}",
        headers={"Allow": allowed},
    )


def _list(
    rows: Callable[[GraphView], Iterable[TopicInfo | ServiceInfo | ActionInfo]],
    request: HttpRequest,
    reader: GraphView,
) -> HttpResponse:
    Query(request)
    return value_response(request, [name_and_type(reader, each) for each in rows(reader)])


def _type(request: HttpRequest, reader: GraphView) -> HttpResponse:
    from rwt.extensions.http.schemas import document  # As the OpenAPI document.

    Query(request)
    message = reader.registry.message(text_below(request.path, _TYPES, "type"))
    return value_response(request, document(message), media=SCHEMA_JSON)


@lru_cache(maxsize=1)
def _page() -> tuple[bytes, Mapping[str, str]]:
    problems = "".join(
        f'<tr id="{name}"><td><code>{name}</code><td>{kind.status}<td>{html.escape(kind.title)}'
        f"<td>{html.escape(kind.instead)}"
        for name, kind in KINDS.items()
    )
    text = files(__package__).joinpath("page.html").read_text("utf-8")
    script = text.partition("<script>")[2].partition("</script>")[0]
    policy = dict(page_policy(script))
    # The page sends requests to the API, which the policy of other pages forbids.
    policy["Content-Security-Policy"] += "; connect-src 'self'"
    return text.replace("<!-- problems -->", problems).encode(), policy
