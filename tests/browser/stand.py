"""A server in the test's own process that also serves the test's pages and the libraries."""

from __future__ import annotations

import mimetypes
from collections.abc import AsyncIterator, Iterable
from contextlib import AsyncExitStack, asynccontextmanager, closing
from dataclasses import dataclass
from pathlib import Path

from rwt.server import serve
from rwt_graph import MemoryGraph, Node
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from rwt_nodes import Rosapi, Tf2WebRepublisher
from rwt_nodes.demo import DemoRobot
from rwt_nodes.video import WebVideoServer
from rwt_transports.http import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route
from tests.browser.driver import HERE, NODE

REGISTRIES = {name: Registry(distro) for name, distro in DISTROS.items()}


@dataclass(frozen=True)
class Stand:
    """A running server.

    Attributes:
        url: of its pages, with a slash at the end.
        graph: what it serves.
        node: to publish and watch with.
    """

    url: str
    graph: MemoryGraph
    node: Node


def files(folder: Path, prefix: str) -> Route:
    """Serves everything in a folder of the tests."""

    def page(request: HttpRequest, reader: Reader) -> HttpResponse:
        path = folder / request.path.removeprefix(prefix)
        kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
        return HttpResponse(path.read_bytes(), content_type=kind)

    return Route(f"{prefix}*", page, Audience.ADMITTED)


@asynccontextmanager
async def stand(
    distro: str, built: Path, *, robot: bool = True, http: Iterable[HttpExtension] = ()
) -> AsyncIterator[Stand]:
    """Serve a graph, with the demo robot on request, and beside it pages for the browser."""
    folders = {"/lib/": NODE / "node_modules", "/built/": built, "/test/": HERE / "pages"}
    served = [HttpExtension(tuple(files(folder, path) for path, folder in folders.items())), *http]
    async with MemoryGraph(registry=REGISTRIES[distro]) as graph, AsyncExitStack() as stack:
        served.append(stack.enter_context(closing(WebVideoServer(graph))).http)
        if robot:
            served.append(stack.enter_context(closing(DemoRobot(graph))).http)
        server = await stack.enter_async_context(serve(graph, "ws://127.0.0.1:0", http=served))
        Rosapi(graph)
        Tf2WebRepublisher(graph)
        yield Stand(server.urls[0].replace("ws", "http", 1) + "/", graph, Node(graph, "test"))
