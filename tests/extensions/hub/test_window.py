"""Window of an uplink on links of any rate and delay, on a virtual clock."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.hub.uplink.window import MAX_BYTES, MIN_BYTES, TARGET_SECONDS, Window

PART = 2048


class Path:
    """Link with a rate, a delay, and a queue without end; one sender that always has something to send."""

    def __init__(self, rate: float, delay: float) -> None:
        self.rate = rate
        self.delay = delay
        self.now = 0.0
        self.window = Window(self.now)
        self.waits: list[tuple[float, float]] = []
        self.acked = 0
        self._sent = 0
        self._free = 0.0
        self._acks: deque[tuple[float, int]] = deque()

    def run(self, seconds: float) -> float:
        """Send for so long, and return the bytes per second that arrived."""
        until, before, began = self.now + seconds, self.acked, self.now
        while self.now < until:
            while self.window.room > 0:
                self._send()
            self.now, total = self._acks.popleft()
            assert self.window.acknowledged(total, self.now)
            self.acked = total
        return (self.acked - before) / (self.now - began)

    def _send(self) -> None:
        self._sent += PART
        self.window.sent(PART, self.now)
        begins = max(self.now, self._free)
        self.waits.append((self.now, begins - self.now))
        self._free = begins + PART / self.rate
        self._acks.append((self._free + self.delay, self._sent))

    def wait(self, since: float) -> float:
        """Return the 99th percentile of the waits in the queue of what was sent since then."""
        waits = sorted(wait for sent, wait in self.waits if sent >= since)
        return waits[len(waits) * 99 // 100]


LINKS = [(1e6, 0.08), (1e6, 0.005), (10e6, 0.03), (100e6, 0.1), (1e9, 0.0002), (64e3, 0.3)]


@pytest.mark.parametrize(("bits", "round_trip"), LINKS)
def test_a_link_is_used_and_its_queue_stays_short(bits: float, round_trip: float) -> None:
    path = Path(bits / 8, round_trip)
    path.run(20.0 if bits <= 10e6 else 5.0)
    settled = path.now
    used = path.run(30.0 if bits <= 10e6 else 2.0)
    # `MIN_BYTES` alone are a queue on a very slow link, and `MAX_BYTES` bound a very fast one.
    possible = min(bits / 8, MAX_BYTES / (round_trip + PART / (bits / 8)))
    assert used >= 0.85 * possible
    assert path.wait(settled) <= max(3 * TARGET_SECONDS, MIN_BYTES / (bits / 8))


def test_the_window_shrinks_with_the_link_and_grows_again() -> None:
    path = Path(10e6 / 8, 0.03)
    path.run(10.0)
    path.rate = 1e6 / 8
    path.run(10.0)
    settled = path.now
    path.run(10.0)
    assert path.wait(settled) <= 3 * TARGET_SECONDS
    path.rate = 10e6 / 8
    path.run(10.0)
    assert path.run(10.0) >= 0.85 * path.rate


def test_a_sender_that_has_little_to_send_keeps_its_window() -> None:
    window, total = Window(0.0), 0
    before = window.limit
    for at in range(200):
        total += 100
        window.sent(100, at * 0.1)
        assert window.acknowledged(total, at * 0.1 + 0.05)
    assert window.limit in (before, 1)
    assert window.round_trip == pytest.approx(0.05)


@pytest.mark.parametrize("total", [-1, 5001, 2**63])
def test_bytes_that_were_not_sent_cannot_arrive(total: int) -> None:
    window = Window(0.0)
    window.sent(5000, 0.0)
    assert not window.acknowledged(total, 1.0)
    assert window.acknowledged(5000, 1.0)
    assert not window.acknowledged(4999, 1.0)


@given(st.lists(st.tuples(st.integers(0, 100_000), st.floats(0, 1e3)), max_size=50))
def test_the_window_stays_within_its_bounds(steps: list[tuple[int, float]]) -> None:
    window, now, sent = Window(0.0), 0.0, 0
    totals = [0]
    for size, seconds in steps:
        window.sent(size, now)
        sent += size
        totals.append(sent)
        now += seconds
        assert window.acknowledged(sent, now)
        assert window.limit == 1 or MIN_BYTES <= window.limit <= MAX_BYTES
        assert window.room == window.limit
    assert all(one <= other for one, other in pairwise(totals))
