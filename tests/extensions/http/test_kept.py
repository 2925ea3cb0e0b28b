"""Calls and goals that outlive their requests, against stand-ins of their clients."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rwt.access.errors import QuotaExceeded
from rwt.extensions.http.calls import HttpCall, KeptTable
from rwt_graph import SimulatedClock
from rwt_participant.errors import CallFailed

ENDED = CallFailed("it has ended")


class Client:
    def __init__(self) -> None:
        self.holds = 0
        self.graph = SimpleNamespace(clock=SimulatedClock())

    def hold(self) -> None:
        self.holds += 1

    def release(self) -> None:
        self.holds -= 1


def kept(client: Any, id: str, *, ended: bool = False) -> HttpCall:
    made = HttpCall(client, "/add")
    made.id, made.outcome = id, ENDED if ended else None
    return made


def test_a_client_at_its_limit_loses_the_oldest_that_has_ended() -> None:
    client: Any = Client()
    table: KeptTable[HttpCall] = KeptTable(1, "calls wait")
    table.add(kept(client, "a", ended=True))
    table.make_room(client)
    second = kept(client, "b")
    table.add(second)
    assert (table.get("a"), table.get("b")) == (None, second)
    with pytest.raises(QuotaExceeded, match=r"1 calls wait, and 1 is the limit \(api.goals\)"):
        table.make_room(client)
    table.forget(second)
    table.forget(second)
    assert (len(table), client.holds) == (0, 0)


def test_what_has_ended_is_forgotten_after_a_while() -> None:
    client: Any = Client()
    table: KeptTable[HttpCall] = KeptTable(100, "calls wait", seconds=5)
    call = kept(client, "a")
    table.end(call)  # It is not kept.
    table.add(call)
    client.graph.clock.advance(10)
    assert table.get("a") is call
    call.outcome = ENDED
    table.end(call)
    client.graph.clock.advance(4)
    assert client.holds == 1
    client.graph.clock.advance(2)
    assert (table.get("a"), client.holds) == (None, 0)
