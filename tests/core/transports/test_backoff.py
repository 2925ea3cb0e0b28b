"""Exponential back-off: it grows up to a bound, varies by no more than its jitter, and may end."""

from __future__ import annotations

from itertools import islice

from rwt_transports.backoff import Backoff


def test_the_wait_doubles_up_to_a_bound() -> None:
    plan = Backoff(first=0.5, longest=30, jitter=0)
    assert [plan.delay(failures) for failures in (1, 2, 3, 7, 8, 10_000)] == [0.5, 1, 2, 30, 30, 30]
    assert list(islice(plan.delays(), 4)) == [0.5, 1, 2, 4]


def test_jitter_stays_within_its_part() -> None:
    found = list(Backoff(first=1.0, factor=1.0, longest=1.0, jitter=0.1, attempts=200).delays())
    assert len(found) == 200
    assert all(0.9 <= delay <= 1.0 for delay in found)
    assert len(set(found)) > 100


def test_attempts_are_used_up() -> None:
    plan = Backoff(first=0.0, attempts=2)
    assert [plan.delay(failures) for failures in (1, 2, 3, 21)] == [0.0, 0.0, None, None]
