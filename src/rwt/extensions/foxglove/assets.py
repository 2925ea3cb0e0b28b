"""Files for clients: ``package://`` URLs of a URDF, read through the server's pages for packages."""

from __future__ import annotations

from collections import deque
from collections.abc import AsyncGenerator, Awaitable, Callable, Sequence
from typing import Final
from urllib.parse import quote

from rwt.access.client_graph import ClientGraph
from rwt.access.graph_view import GraphView
from rwt.extensions.foxglove.errors import NotPossible
from rwt.extensions.foxglove.files_in_transit import MAX_BYTES, FilesInTransit
from rwt.extensions.foxglove.replies import FoxgloveReplies
from rwt.extensions.foxglove.wire.client_messages import FetchAsset
from rwt.extensions.foxglove.wire.server_messages import asset, asset_failure
from rwt_transports.http.routes import HttpExtension, HttpRequest, HttpResponse
from rwt_transports.shared_pool import Share
from rwt_transports.websocket.close_codes import TRY_AGAIN_LATER

SCHEME: Final = "package://"
PATH: Final = "/packages/"

MAX_WAITING: Final = 256
"""Maximum number of pending requests of a client."""

_UNREAD: Final = 1024 * 1024
"""Bytes that may wait for the client before the next file is read for it."""

Pages = Callable[[HttpRequest, "GraphView"], "HttpResponse | Awaitable[HttpResponse]"]
"""Page that answers requests below :data:`PATH`."""


class Assets:
    """Files that one client has requested, sent one at a time."""

    def __init__(
        self,
        graph: ClientGraph,
        replies: FoxgloveReplies,
        pages: Pages,
        address: str,
        files: FilesInTransit,
    ) -> None:
        self._graph = graph
        self._replies = replies
        self._pages = pages
        self._address = address
        self._files = files
        self._share: Share | None = None
        self._asked: deque[FetchAsset] = deque()
        self._runs = False
        self._closed = False

    def fetch(self, asked: FetchAsset, spawn: Callable[[Callable[[], Awaitable[None]], str], None]) -> None:
        """Send a file, or the reason why it is not available."""
        uri, id = asked.uri, asked.request_id
        if not uri.startswith(SCHEME):
            self._fail(id, f"{uri[:200]!r}: only files of packages are served, {SCHEME}NAME/PATH")
            return
        if len(self._asked) >= MAX_WAITING:
            self._fail(id, f"{len(self._asked)} files are waited for already, which is the limit")
            return
        self._asked.append(asked)
        if not self._runs:
            self._runs = True
            spawn(self._run, "a client's assets")

    async def _run(self) -> None:
        try:
            while self._asked and not self._closed:
                asked = self._asked.popleft()
                share = await self._files.enter(self._graph.holder, self._cut, self._is_open)
                if share is None:
                    return
                self._share = share
                try:
                    await self._send(asked, share)
                finally:
                    self._files.pool.release(share)
        finally:
            self._runs = False

    def _is_open(self) -> bool:
        return not self._closed

    async def _send(self, asked: FetchAsset, share: Share) -> None:
        """Send a file, and wait until the client has read most of it."""
        try:
            chunks = await self._read(asked.uri.removeprefix(SCHEME))
        except (NotPossible, OSError) as error:
            self._fail(asked.request_id, str(error))
            return
        self._files.pool.resize(share, sum(map(len, chunks)))
        if not self._closed:
            self._replies.send(asset(asked.request_id, chunks))
        del chunks
        await self._files.read(self._is_unread, self._cut)

    def _is_unread(self) -> bool:
        return self._replies.sink.backlog > _UNREAD and not self._closed

    def _cut(self, reason: str) -> None:
        self._closed = True
        self._replies.sink.close(TRY_AGAIN_LATER, reason)

    async def _read(self, path: str) -> list[bytes]:
        request = HttpRequest("GET", PATH + quote(path, safe="/%"), address=self._address)
        clock = self._graph.clock
        began = clock.monotonic()
        answer = self._pages(request, self._graph)
        self._graph.work.add(clock.monotonic() - began, "pages")
        response = answer if isinstance(answer, HttpResponse) else await answer
        body = response.body
        if response.status != 200:
            raise NotPossible((body if isinstance(body, bytes) else b"").decode("utf-8", "replace").strip())
        if isinstance(body, bytes):
            self._check(len(body))
            return [body]
        chunks: list[bytes] = []
        size = 0
        try:
            async for chunk in body:
                size += len(chunk)
                # For each chunk: a stream does not state its size.
                self._check(size)
                if self._closed:
                    break
                chunks.append(chunk)
        finally:
            # An abandoned page is closed at once; garbage collection would release its file later.
            if isinstance(body, AsyncGenerator):
                await body.aclose()
        return chunks

    def _check(self, size: int) -> None:
        if size > MAX_BYTES:
            raise NotPossible(f"the file is larger than {MAX_BYTES} bytes")
        if reason := self._replies.too_large(size):
            raise NotPossible(reason)

    def _fail(self, request_id: int, reason: str) -> None:
        self._graph.counters.refuse("fetchAsset")
        if not self._closed:
            self._replies.send(asset_failure(request_id, reason))

    def close(self) -> None:
        """Discard all requests."""
        self._closed = True
        self._asked.clear()
        if self._share is not None:
            self._files.pool.release(self._share)


def package_pages(http: Sequence[HttpExtension]) -> Pages | None:
    """Return the page that serves files of packages, from the pages of nodes; None if no node has any."""
    found = {
        route.path: route.page
        for extension in http
        for route in extension.routes
        if route.path.startswith(PATH) and route.path.endswith("/*") and route.method == "GET"
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
