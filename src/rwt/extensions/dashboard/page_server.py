"""Server of the dashboard alone, for robots with another rosbridge server."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Final, NoReturn

from rwt.access.quotas import WorkLimit, WorkTotals
from rwt.errors import ServerError
from rwt.extensions.dashboard import MISSING, WebPage, WebPageError, find_static_files
from rwt_transports.endpoint import PeerInfo, Sink
from rwt_transports.errors import Refused
from rwt_transports.http.routes import HttpRequest, HttpResponse, Page, Routes
from rwt_transports.listener import Listener, listen
from rwt_transports.shared_pool import Holder

_HERE_IS_NO_ROBOT: Final = "there is no robot here: this port serves the page alone"


class _Nobody:
    """Reader of static pages, which do not depend on the robot.

    This server has no credentials: who reaches it may open its layouts.
    """

    is_admitted = True
    work = WorkLimit(0.0, 0.0, WorkTotals(), time.monotonic)
    holder = Holder()

    def may_subscribe(self, topic: str) -> bool:
        return False

    def while_allowed(self, topics: Iterable[str], end: Callable[[str], None]) -> NoReturn:
        raise Refused(403, _HERE_IS_NO_ROBOT)


@asynccontextmanager
async def serve_page(
    url: str,
    robot: str | None = None,
    *,
    layouts: Path | None = None,
) -> AsyncIterator[Listener]:
    """Serve the page within the block.

    Args:
        url: URL to listen on, ``ws://HOST:PORT``.
        robot: rosbridge server that the page connects to; None: the page asks.
        layouts: folder of layouts.

    Raises:
        ServerError: the page is not built, or an argument cannot be used.
        TransportError: the URL cannot be listened on.
    """
    files = find_static_files()
    if files is None:
        raise ServerError(MISSING)
    try:
        page = WebPage(files, robot=robot, layouts=layouts)
    except WebPageError as error:
        raise ServerError(str(error)) from error
    routes = Routes()

    for route in page.http.routes:
        routes.get(route.path, partial(_answer, route.page))
    async with listen(url, _refuse, routes=routes) as listener:
        yield listener


def _answer(page: Page, request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
    return page(request, _Nobody())


def _refuse(sink: Sink, info: PeerInfo) -> NoReturn:
    raise Refused(404, _HERE_IS_NO_ROBOT)
