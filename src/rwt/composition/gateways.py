"""Gateways of a server besides rosbridge."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from rwt.access.access import Access
from rwt.access.graph_view import GraphView
from rwt.access.settings import SettingsError
from rwt.composition.extensions import extension_for
from rwt.extensions.foxglove.assets import Pages
from rwt.gateways.base import Gateway, MakeGateway
from rwt.settings.models import Settings
from rwt_graph.api import Graph
from rwt_transports.http.routes import HttpExtension, HttpRequest, HttpResponse

# Optional parts are imported in the functions that create them.

_PACKAGES: Final = "/packages/"
"""Path of the files of robot descriptions."""


def _foxglove(graph: Graph, settings: Settings, access: Access, http: Sequence[HttpExtension]) -> Gateway:
    from rwt.extensions.foxglove.gateway import FoxgloveGateway

    call_timeout = settings.default_call_service_timeout or None
    return FoxgloveGateway(
        graph, access, settings.foxglove, call_timeout, settings.unregister_timeout, package_pages(http)
    )


def _http(graph: Graph, settings: Settings, access: Access, http: Sequence[HttpExtension]) -> Gateway:
    from rwt.extensions.http import HttpGateway

    offered = {"gateways": ["rosbridge", *settings.gateways], "nodes": list(settings.nodes)}
    several = settings.workers > 1
    linger = settings.unregister_timeout
    return HttpGateway(graph, access, settings.api, linger, offered, several_processes=several)


def _mcp(graph: Graph, settings: Settings, access: Access, http: Sequence[HttpExtension]) -> Gateway:
    try:
        from rwt.extensions.mcp.gateway import McpGateway
    except ModuleNotFoundError as error:
        raise SettingsError(
            f"`gateways`: mcp needs {error.name}, which is not installed: pip install 'robot-web-tools[mcp]'"
        ) from None
    from rwt.extensions.mcp.recordings import RecordingFolder

    folder = settings.mcp.recordings
    recordings = None if folder is None else RecordingFolder(folder)
    several = settings.workers > 1
    return McpGateway(graph, access, settings.mcp, recordings, several_processes=several)


GATEWAYS: Final[Mapping[str, Callable[[Graph, Settings, Access, Sequence[HttpExtension]], Gateway]]] = (
    MappingProxyType({"foxglove": _foxglove, "http": _http, "mcp": _mcp})
)
"""Built-in gateways by name. A row imports its package when it is called, because few servers use all."""


def make_gateway(
    name: str, graph: Graph, settings: Settings, access: Access, http: Sequence[HttpExtension]
) -> Gateway:
    """Create a built-in gateway, or that of an entry point in `rwt.gateways`. Raises SettingsError."""
    builtin = GATEWAYS.get(name)
    if builtin is not None:
        return builtin(graph, settings, access, http)
    make: MakeGateway = extension_for("gateways", "rwt.gateways", name, GATEWAYS)
    return make(graph, access)


def package_pages(http: Sequence[HttpExtension]) -> Pages | None:
    """Return the page that serves files of packages, from the pages of nodes; None if no node has any."""
    found = {
        route.path: route.page
        for extension in http
        for route in extension.routes
        if route.path.startswith(_PACKAGES) and route.path.endswith("/*") and route.method == "GET"
    }
    if not found:
        return None

    def answer(request: HttpRequest, view: GraphView) -> HttpResponse | Awaitable[HttpResponse]:
        fitting = [path for path in found if request.path.startswith(path[:-1])]
        if not fitting:
            known = " ".join(sorted(found))
            return HttpResponse(f"{request.path} is below none of {known}\n".encode(), 404)
        return found[max(fitting, key=len)](request, view)

    return answer
