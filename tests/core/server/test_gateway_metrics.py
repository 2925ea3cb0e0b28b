"""Metrics that all gateways have in common."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from rwt.delivery.counters import Counters
from rwt.gateways.visitors import Visitor, Visitors, counted
from rwt_graph.clock import SimulatedClock
from rwt_transports.http.connection import close_iterator
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route
from tests.page_readers import SeesNothing


def test_a_visitor_is_there_until_some_seconds_after_its_last_request() -> None:
    counters, clock = Counters(), SimulatedClock()
    visitors: Visitors[Visitor] = Visitors(counters, clock, 10.0)
    visitors.find("one", Visitor).hold()
    visitors.find("one", Visitor).hold()
    visitors.find("other", Visitor).hold()
    visitors.find("one", Visitor).release()
    clock.advance(60)
    assert (counters.clients, counters.present) == (2, 2)
    visitors.find("one", Visitor).release()
    clock.advance(9)
    visitors.find("one", Visitor).hold()
    clock.advance(60)
    assert (counters.clients, counters.present) == (2, 2)
    visitors.find("one", Visitor).release()
    visitors.find("other", Visitor).release()
    clock.advance(10.1)
    assert (counters.clients, counters.present) == (2, 0)
    visitors.find("one", Visitor).hold()
    assert (counters.clients, counters.present) == (3, 1)


class Pieces(AsyncIterator[bytes]):
    """A stream of three pieces, which notes when it is closed."""

    def __init__(self) -> None:
        self.left = [b"one", b"three", b"fiver"]
        self.closed = 0

    async def __anext__(self) -> bytes:
        if not self.left:
            raise StopAsyncIteration
        return self.left.pop(0)

    async def aclose(self) -> None:
        self.closed += 1


@pytest.mark.anyio
async def test_requests_answers_and_pieces_of_streams_are_counted_with_their_bodies() -> None:
    counters, pieces = Counters(), Pieces()

    async def later(request: HttpRequest, reader: Reader) -> HttpResponse:
        return HttpResponse(pieces)

    pages: HttpExtension = HttpExtension(
        (
            Route("/now", lambda request, reader: HttpResponse(b"12345"), Audience.ADMITTED),
            Route("/later", later, Audience.ADMITTED, "POST"),
        )
    )
    now, of_stream = (route.page for route in counted(pages, counters).routes)
    reader = SeesNothing()
    now(HttpRequest("GET", "/now"), reader)
    now(HttpRequest("HEAD", "/now"), reader)
    assert (counters.received, counters.received_bytes) == (2, 0)
    assert (counters.sent, counters.sent_bytes) == (2, 5)

    answer = of_stream(HttpRequest("POST", "/later", body=b"x" * 100), reader)
    assert not isinstance(answer, HttpResponse)
    body = (await answer).body
    assert not isinstance(body, bytes)
    assert [await anext(body), await anext(body)] == [b"one", b"three"]
    assert (counters.received, counters.received_bytes) == (3, 100)
    assert (counters.sent, counters.sent_bytes) == (4, 13)
    await close_iterator(body)
    assert pieces.closed == 1
