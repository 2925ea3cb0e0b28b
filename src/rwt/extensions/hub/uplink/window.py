"""Limit of the bytes that are under way on an uplink, so that urgent frames find short queues.

TCP alone fills every queue on the path: at 1 Mbit/s, a sample then waits for seconds. The window follows the
delay, as FAST TCP does (Jin, Wei and Low, 2004): in each round trip,

    aim = window * (shortest round trip + TARGET_SECONDS) / round trip
    window = (window + aim) / 2, and at most twice the former one

So it grows while the path's queue delays frames by less than `TARGET_SECONDS`, and shrinks beyond. Rounds in
which the window was not used up leave it as it is. As a queue of one's own hides the shortest round trip, one
frame at a time is sent for one round every `PROBE_SECONDS`.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import Final

TARGET_SECONDS: Final = 0.03
"""Delay in queues of the path that the window aims at, in seconds."""
MIN_BYTES: Final = 6 * 1024
MAX_BYTES: Final = 4 * 1024 * 1024
FIRST_BYTES: Final = MIN_BYTES
"""Window of a new connection."""
PROBE_SECONDS: Final = 10.0
"""Seconds between two measurements of the shortest round trip."""
_MAX_GROWTH: Final = 2.0
_GAIN: Final = 0.5
"""Part of the way to its aim that the window goes in a round, as in FAST TCP: more would oscillate."""


class Window:
    """Window of one direction of a connection.

    Attributes:
        round_trip: seconds of the last round trip; 0.0 before the first.
        shortest: shortest round trip of this and the last measurement, in seconds.
        rate: bytes per second that arrived in the last round; 0.0 before the first.
    """

    __slots__ = (
        "_acked", "_begun", "_former", "_is_probing", "_is_used_up", "_probed", "_round_bytes", "_round_end",
        "_sent", "_times", "_window", "rate", "round_trip", "shortest",
    )  # fmt: skip

    def __init__(self, now: float) -> None:
        self._window = float(FIRST_BYTES)
        self._sent = self._acked = 0
        self._times: deque[tuple[int, float]] = deque()
        self._round_end = 0
        self._round_bytes = 0
        self._begun = self._probed = now
        self._is_used_up = self._is_probing = False
        self._former = inf
        self.round_trip = 0.0
        self.shortest = inf
        self.rate = 0.0

    @property
    def limit(self) -> int:
        """Maximum number of bytes under way."""
        return 1 if self._is_probing else int(self._window)

    @property
    def room(self) -> int:
        """Bytes that may be sent now. A frame may exceed it."""
        return self.limit - (self._sent - self._acked)

    def sent(self, size: int, now: float) -> None:
        """Count bytes that are sent."""
        if self._sent == self._acked:
            self._begin_round(now)
        self._sent += size
        self._times.append((self._sent, now))
        if self.room <= 0:
            self._is_used_up = True

    def acknowledged(self, total: int, now: float) -> bool:
        """Count all bytes that have arrived since the connection began.

        Returns:
            False if the other side cannot have received so many.
        """
        if not self._acked <= total <= self._sent:
            return False
        self._acked = total
        since = None
        while self._times and self._times[0][0] <= total:
            _, since = self._times.popleft()
        if since is not None:
            self.round_trip = now - since
            self.shortest = min(self.shortest, self.round_trip)
            if total >= self._round_end:
                self._end_round(now)
        return True

    def _end_round(self, now: float) -> None:
        if now > self._begun:
            self.rate = (self._acked - self._round_bytes) / (now - self._begun)
        if self._is_used_up and not self._is_probing:
            shortest = min(self.shortest, self._former)
            aim = self._window * (shortest + TARGET_SECONDS) / max(self.round_trip, 1e-6)
            grown = min((1 - _GAIN) * self._window + _GAIN * aim, _MAX_GROWTH * self._window)
            self._window = min(max(grown, MIN_BYTES), MAX_BYTES)
        self._is_probing = False
        if now - self._probed >= PROBE_SECONDS:
            self._probed, self._is_probing = now, True
            self._former, self.shortest = self.shortest, inf
        self._begin_round(now)

    def _begin_round(self, now: float) -> None:
        self._begun = now
        self._round_bytes = self._acked
        self._round_end = self._sent + 1
        self._is_used_up = self.room <= 0
