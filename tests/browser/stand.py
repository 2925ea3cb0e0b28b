"""A server in the test's own process that also serves the test's pages and the libraries."""

from __future__ import annotations

import mimetypes
from collections.abc import AsyncIterator, Iterable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rwt import Server
from rwt_graph import Graph, Node
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route
from rwt_webrtc.settings import WebRtcSettings
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
    graph: Graph
    node: Node

    async def slow_down(self) -> None:
        """Have the demo robot creep, so that it is under way for longer than any machine takes to look."""
        await self.node.params.set("/demo_robot:max_speed", 0.02)


def files(folder: Path, prefix: str) -> Route:
    """Serves everything in a folder of the tests."""

    def page(request: HttpRequest, reader: Reader) -> HttpResponse:
        path = folder / request.path.removeprefix(prefix)
        kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
        return HttpResponse(path.read_bytes(), content_type=kind)

    return Route(f"{prefix}*", page, Audience.ADMITTED)


@asynccontextmanager
async def stand(
    distro: str,
    built: Path,
    *,
    robot: bool = True,
    http: Iterable[HttpExtension] = (),
    webrtc: bool = False,
    gate: Mapping[str, Any] = MappingProxyType({}),
) -> AsyncIterator[Stand]:
    """Serve a graph, with the demo robot on request, and beside it pages for the browser."""
    folders = {"/lib/": NODE / "node_modules", "/built/": built, "/test/": HERE / "pages"}
    served = [HttpExtension(tuple(files(folder, path) for path, folder in folders.items())), *http]
    async with Server(
        "ws://127.0.0.1:0",
        registry=REGISTRIES[distro],
        http=served,
        demo=robot,
        webrtc=WebRtcSettings(enabled=webrtc),
        gate=dict(gate),
    ) as server:
        yield Stand(server.urls[0].replace("ws", "http", 1) + "/", server.graph, server.node("test"))
