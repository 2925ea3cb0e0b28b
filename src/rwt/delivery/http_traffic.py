"""Counters of HTTP requests and responses, for all gateways."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from rwt_transports.http.connection import close_iterator
from rwt_transports.http.routes import HttpResponse

if TYPE_CHECKING:
    from rwt.delivery.counters import Counters
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer
    from rwt_transports.http.routes import AnyReader, HttpExtension, HttpRequest


def counted(extension: HttpExtension[AnyReader], counters: Counters) -> HttpExtension[AnyReader]:
    """Return a gateway's HTTP extension with counted requests and responses.

    Bytes are those of bodies. Of an answer that is a stream each piece counts as a message.
    """
    routes = tuple(replace(route, page=partial(_answer, route.page, counters)) for route in extension.routes)
    return replace(extension, routes=routes)


def _answer(
    page: Callable[[HttpRequest, AnyReader], HttpResponse | Awaitable[HttpResponse]],
    counters: Counters,
    request: HttpRequest,
    reader: AnyReader,
) -> HttpResponse | Awaitable[HttpResponse]:
    counters.requested(len(request.body))
    answer = page(request, reader)
    if isinstance(answer, HttpResponse):
        return _count(answer, counters, request)
    return _count_later(answer, counters, request)


async def _count_later(
    answer: Awaitable[HttpResponse], counters: Counters, request: HttpRequest
) -> HttpResponse:
    return _count(await answer, counters, request)


def _count(answer: HttpResponse, counters: Counters, request: HttpRequest) -> HttpResponse:
    if isinstance(answer.body, bytes):
        counters.answered(0 if request.method == "HEAD" else len(answer.body))
        return answer
    return replace(answer, body=_CountedStream(answer.body, counters))


class _CountedStream(AsyncIterator[bytes]):
    """Pieces of a stream, counted when they are sent."""

    def __init__(self, pieces: AsyncIterator[bytes], counters: Counters) -> None:
        self._pieces = pieces
        self._counters = counters

    async def __anext__(self) -> bytes:
        piece = await anext(self._pieces)
        self._counters.answered(len(piece))
        return piece

    async def aclose(self) -> None:
        """Hear no more of it."""
        await close_iterator(self._pieces)


class Visitors:
    """Clients that have no connection, and are there from a request until some seconds after their last one.

    Args:
        counters: where they are counted.
        clock: says when they have gone.
        linger: see above.
    """

    def __init__(self, counters: Counters, clock: Clock, linger: float) -> None:
        self._counters = counters
        self._clock = clock
        self._linger = linger
        self._requests: dict[str, int] = {}
        self._leaving: dict[str, Timer] = {}

    def begin(self, name: str) -> None:
        """Count a request of the client of that name."""
        leaving = self._leaving.pop(name, None)
        if leaving is not None:
            leaving.cancel()
        elif name not in self._requests:
            self._counters.clients += 1
            self._counters.present += 1
        self._requests[name] = self._requests.get(name, 0) + 1

    def end(self, name: str) -> None:
        """Count a response."""
        self._requests[name] -= 1
        if not self._requests[name]:
            del self._requests[name]
            self._leaving[name] = self._clock.call_later(self._linger, partial(self._gone, name))

    def _gone(self, name: str) -> None:
        del self._leaving[name]
        self._counters.present -= 1

    def close(self) -> None:
        """Wait for nobody to leave."""
        for leaving in self._leaving.values():
            leaving.cancel()
