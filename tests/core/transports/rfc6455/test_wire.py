"""The WebSocket wire against RFC 6455, as raw bytes: in memory, and over sockets under every driver."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.core.transports.rfc6455.case import Case, Chapter
from tests.core.transports.rfc6455.chapters import CHAPTERS
from tests.core.transports.rfc6455.frames import text
from tests.core.transports.rfc6455.handshake import ACCEPT, HANDSHAKES, Handshake
from tests.core.transports.rfc6455.sites import (
    SENTINEL,
    STACKS,
    Exchange,
    check,
    ends_with_sentinel,
    in_memory,
    over_sockets,
    play,
)

CASES = [
    pytest.param(case, id=f"{chapter.title}: {case.name}") for chapter in CHAPTERS for case in chapter.cases
]


@pytest.fixture(scope="module", params=["memory", *STACKS])
def exchange(request: pytest.FixtureRequest) -> Iterator[Exchange]:
    if request.param == "memory":
        yield in_memory
        return
    with over_sockets(request.param) as found:
        yield found


@pytest.mark.parametrize("case", CASES)
def test_the_server_does_what_the_rfc_says(exchange: Exchange, case: Case) -> None:
    check(case, play(exchange, case, 0))


@pytest.mark.parametrize("case", CASES)
def test_cuts_do_not_matter(case: Case) -> None:
    for cut in case.cuts:
        check(case, play(in_memory, case, cut))


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda chapter: chapter.title)
def test_cuts_do_not_matter_on_the_network(exchange: Exchange, chapter: Chapter) -> None:
    small = [case for case in chapter.cases if len(case.sent) <= 200]
    for case in small[:: max(1, len(small) // 8)]:
        check(case, play(exchange, case, 1))


@pytest.mark.parametrize("handshake", HANDSHAKES, ids=lambda handshake: handshake.name)
def test_the_opening_handshake(exchange: Exchange, handshake: Handshake) -> None:
    opens = handshake.status == 101
    data, _ = exchange(
        "default", handshake.request, [text(SENTINEL)] if opens else [], ends_with_sentinel if opens else None
    )
    assert data.split(b" ", 2)[:2] == [b"HTTP/1.1", b"%d" % handshake.status]
    assert (ACCEPT in data) is opens
