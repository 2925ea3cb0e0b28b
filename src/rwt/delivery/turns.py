"""Turns of the event loop by the timers of a graph's clock, which also simulated clocks have."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from rwt_transports.turns import CLIENTS_SECONDS, Turns

if TYPE_CHECKING:
    from rwt_graph.clock import Clock


def turns_of(clock: Clock, seconds: float, *, one_at_a_time: bool = False) -> Turns:
    """Return turns with a budget of `seconds` each."""
    return Turns(
        seconds,
        partial(clock.call_later, 0.0),
        clock.call_later,
        clock.monotonic,
        one_at_a_time=one_at_a_time,
    )


def client_turns(clock: Clock) -> Turns:
    """Return the turns that all clients of a gateway share.

    Waiting work is done one client at a time, and so is the work of clients beyond their rate. So however
    many clients have much to do, one that sends a small message now and then waits for one of them at most.
    While nobody else needs the server they lose nothing: turns follow each other at once.
    """
    return turns_of(clock, CLIENTS_SECONDS, one_at_a_time=True)
