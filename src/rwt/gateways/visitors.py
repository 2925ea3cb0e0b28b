"""Clients over HTTP: when they are present, the work that they cause, and the traffic of their requests.

HTTP clients do not disconnect. Requests of one credential, role and address count as one client, which is
present until some seconds after the last request (:class:`Visitor`).
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Generator, Hashable
from dataclasses import replace
from functools import partial
from typing import Any, Generic, TypeVar

from rwt.delivery.counters import Counters
from rwt_graph.clock import Clock
from rwt_participant.timers import Timer
from rwt_transports.endpoint import PeerInfo
from rwt_transports.http.connection import close_iterator
from rwt_transports.http.routes import AnyReader, HttpExtension, HttpRequest, HttpResponse

T = TypeVar("T")
V = TypeVar("V", bound="Visitor")


def peer_of(request: HttpRequest) -> PeerInfo:
    """Return a request in the form in which admission knows connections."""
    target = f"{request.path}?{request.query}" if request.query else request.path
    return PeerInfo("http", request.address, 0, target, request.headers)


def url_of(request: HttpRequest, scheme: str) -> str:
    """Return the URL under which a client reaches the server, with `http` or `ws` as scheme, or encrypted.

    Below a path of a proxy it ends with a slash: proxies answer the path without one with a redirect, which
    WebSocket clients do not follow.
    """
    secure = "s" if request.headers.get("x-forwarded-proto") in ("https", "wss") else ""
    path = f"{request.prefix}/" if request.prefix else ""
    return f"{scheme}{secure}://{request.headers.get('host', 'localhost:9090')}{path}"


def then(
    answer: HttpResponse | Awaitable[HttpResponse], do: Callable[[HttpResponse], HttpResponse]
) -> HttpResponse | Awaitable[HttpResponse]:
    """Apply a function to a response: now, or once it is available."""
    return do(answer) if isinstance(answer, HttpResponse) else _later(answer, do)


async def _later(answer: Awaitable[HttpResponse], do: Callable[[HttpResponse], HttpResponse]) -> HttpResponse:
    return do(await answer)


class Visitor:
    """Clients over HTTP that count as one.

    Life cycle::

        find() ──> held ──── last release() ────> lingering ──── `linger` s ────> gone
                    ▲                                 │
                    └───────────── hold() ────────────┘

    A request holds the visitor while it is answered, and so does everything that outlives its request.
    """

    __slots__ = ("_holds", "_timer", "_visitors", "key")

    def __init__(self, visitors: Visitors[Any], key: Hashable) -> None:
        self._visitors = visitors
        self._holds = 0
        self._timer: Timer | None = None  # Runs while the visitor lingers.
        self.key = key

    def hold(self) -> None:
        """Keep the visitor present until :meth:`release`."""
        self._holds += 1
        self._stop_timer()

    def release(self) -> None:
        """Undo one :meth:`hold`. Without holds, the visitor leaves after `linger` seconds."""
        self._holds -= 1
        # Not at once: the next request of a client without a connection finds its topics and leases again.
        if not self._holds:
            self._timer = self._visitors.clock.call_later(self._visitors.linger, self.leave)

    def leave(self) -> None:
        """Remove the visitor from its gateway; a subclass also releases what the visitor has."""
        self._stop_timer()
        self._visitors.forget(self)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class Visitors(Generic[V]):
    """All visitors of one gateway."""

    def __init__(self, counters: Counters, clock: Clock, linger: float) -> None:
        self._counters = counters
        self._present: dict[Hashable, V] = {}
        self.clock = clock
        self.linger = linger

    @property
    def present(self) -> tuple[V, ...]:
        """Visitors that are present, in the order they came."""
        return tuple(self._present.values())

    def __contains__(self, key: Hashable) -> bool:
        return key in self._present

    @property
    def keys(self) -> tuple[Any, ...]:
        """Keys of the visitors that are present."""
        return tuple(self._present)

    def find(self, key: Hashable, make: Callable[[Visitors[V], Hashable], V]) -> V:
        """Return the visitor with this key, made by `make` if it is not present."""
        visitor = self._present.get(key)
        if visitor is None:
            self._counters.clients += 1
            self._counters.present += 1
            visitor = self._present[key] = make(self, key)
        return visitor

    def forget(self, visitor: V) -> None:
        """Remove a visitor that leaves."""
        if self._present.pop(visitor.key, None) is not None:
            self._counters.present -= 1

    def close(self) -> None:
        """Let every visitor leave."""
        for visitor in self.present:
            visitor.leave()


class Metered(Awaitable[T]):
    """Awaitable that charges its seconds of work at each suspension and at its end."""

    __slots__ = ("_awaitable", "_charge", "_monotonic")

    def __init__(
        self, awaitable: Awaitable[T], charge: Callable[[float], object], monotonic: Callable[[], float]
    ) -> None:
        self._awaitable = awaitable
        self._charge = charge
        self._monotonic = monotonic

    def __await__(self) -> Generator[Any, Any, T]:
        steps: Any = self._awaitable.__await__()
        step: Callable[[], Any] = partial(next, steps)
        while True:
            began = self._monotonic()
            try:
                waited_for = step()
            except StopIteration as end:
                result: T = end.value
                return result
            finally:
                self._charge(self._monotonic() - began)
            # Exceptions and values from the event loop go on to the wrapped awaitable, as `yield from` would
            # pass them.
            try:
                sent = yield waited_for
            except BaseException as error:
                step = partial(steps.throw, error)
            else:
                step = partial(next, steps) if sent is None else partial(steps.send, sent)


def counted(extension: HttpExtension[AnyReader], counters: Counters) -> HttpExtension[AnyReader]:
    """Count the requests for the pages of a gateway, and their responses.

    Bytes are those of bodies. Each piece of a streamed response counts as a message.
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
    return then(page(request, reader), partial(_count, counters, request))


def _count(counters: Counters, request: HttpRequest, answer: HttpResponse) -> HttpResponse:
    if isinstance(answer.body, bytes):
        # A response to HEAD has headers only, whatever its page returns (RFC 9110 section 9.3.2).
        counters.answered(0 if request.method == "HEAD" else len(answer.body))
        return answer
    return replace(answer, body=_CountedStream(answer.body, counters))


class _CountedStream(AsyncIterator[bytes]):
    """Pieces of a streamed response, counted when they are sent."""

    def __init__(self, pieces: AsyncIterator[bytes], counters: Counters) -> None:
        self._pieces = pieces
        self._counters = counters

    async def __anext__(self) -> bytes:
        piece = await anext(self._pieces)
        self._counters.answered(len(piece))
        return piece

    async def aclose(self) -> None:
        await close_iterator(self._pieces)
