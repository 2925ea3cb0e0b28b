"""Clients over two servers of one graph: every message comes to each of them once, in order."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from bench.fleet.two_servers import measure, two_servers
from bench.fleet.workers import Workers, take_turn


@pytest.mark.timeout(90)
def test_every_message_comes_to_every_client_of_two_servers_once_and_in_order() -> None:
    with ExitStack() as stack:
        outcome = measure(two_servers(stack), clients=60, rate=50.0, count=60)
    assert outcome.due == 60 * 4 * 60
    assert outcome.good, outcome


@pytest.mark.timeout(60)
def test_every_message_comes_to_every_client_of_two_workers() -> None:
    server = Workers(2)
    try:
        turn = take_turn(server, subscribers=40, rate=100.0, seconds=0.5)
    finally:
        server.stop()
    assert turn.lost == 0
    assert turn.delivered == 50 * 40
    assert len(turn.cpu) == 2
