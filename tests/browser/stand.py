"""A server in the test's own process that also serves the test's pages and the libraries."""

from __future__ import annotations

import mimetypes
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.server import serve
from rwt_graph import MemoryGraph, Node
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from rwt_nodes import Rosapi, Tf2WebRepublisher
from rwt_nodes.demo import DemoRobot
from rwt_nodes.video import WebVideoServer
from rwt_transports.http import HttpRequest, HttpResponse
from tests.browser.driver import HERE, NODE

if TYPE_CHECKING:
    from rwt.pages import MaySubscribe, Page

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


def files(folder: Path, prefix: str) -> Page:
    """Serves everything in a folder of the tests."""

    def page(request: HttpRequest, may_subscribe: MaySubscribe) -> HttpResponse:
        path = folder / request.path.removeprefix(prefix)
        kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
        return HttpResponse(path.read_bytes(), content_type=kind)

    return page


@asynccontextmanager
async def stand(
    distro: str, built: Path, *, robot: bool = True, pages: Mapping[str, Page] | None = None
) -> AsyncIterator[Stand]:
    """Serve a graph, with the demo robot on request, and beside it pages for the browser."""
    served: dict[str, Page] = {
        "/lib/*": files(NODE / "node_modules", "/lib/"),
        "/built/*": files(built, "/built/"),
        "/test/*": files(HERE / "pages", "/test/"),
        **(pages or {}),
    }
    async with MemoryGraph(registry=REGISTRIES[distro]) as graph, AsyncExitStack() as stack:
        served.update(stack.enter_context(closing(WebVideoServer(graph))).pages)
        if robot:
            served.update(stack.enter_context(closing(DemoRobot(graph))).pages)
        server = await stack.enter_async_context(serve(graph, "ws://127.0.0.1:0", pages=served))
        Rosapi(graph)
        Tf2WebRepublisher(graph)
        yield Stand(server.urls[0].replace("ws", "http", 1) + "/", graph, Node(graph, "test"))
