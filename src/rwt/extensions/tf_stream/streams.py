"""Streams of transforms to one client: feedback of a goal, or a separate topic."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from time import thread_time
from typing import Final

from rwt_graph import Node
from rwt_tf2 import StampedTransform, Transform, write_transform

FEEDBACK_TIMEOUT: Final = 10.0
"""Time that a goal continues without a reader of its feedback, in seconds: a page may reconnect."""

DIGITS: Final = 6
"""Number of decimals sent: a micrometre, a microradian. Full precision would double the size in JSON."""


def to_message(transforms: Iterable[StampedTransform]) -> dict[str, object]:
    """Return the fields of the feedback and of `TFArray`."""
    return {"transforms": [write_transform(_rounded(each)) for each in transforms]}


def _rounded(stamped: StampedTransform) -> StampedTransform:
    (x, y, z), (qx, qy, qz, qw) = stamped.transform.translation, stamped.transform.rotation
    return StampedTransform(
        stamped.parent,
        stamped.child,
        stamped.stamp_ns,
        Transform(
            (round(x, DIGITS), round(y, DIGITS), round(z, DIGITS)),
            (round(qx, DIGITS), round(qy, DIGITS), round(qz, DIGITS), round(qw, DIGITS)),
        ),
    )


class Stream:
    """Stream of transforms to one client: feedback of a goal, or a topic (TFR-09).

    Nothing is sent without a reader, and each new one receives all transforms.

    Args:
        period: seconds between two updates.
        readers: returns the number of readers now.
        forget: makes every transform due, for a new reader.
        send: sends the transforms that are due, if any (TFR-06).
        timeout: seconds without a reader after which the stream ends.
        on_end: called once when it has ended.

    Attributes:
        reason: reason why it was stopped; empty while it runs, and if its client has ended it.
    """

    def __init__(
        self,
        node: Node,
        period: float,
        readers: Callable[[], int],
        forget: Callable[[], None],
        send: Callable[[], None],
        timeout: float,
        on_end: Callable[[], object],
    ) -> None:
        self.reason = ""
        self._monotonic = node.clock.monotonic
        self._readers = readers
        self._forget = forget
        self._send = send
        self._timeout = timeout
        self._on_end: Callable[[], object] | None = on_end
        self._last_readers = 0
        self._read_at = self._monotonic()
        self._timer = node.create_timer(period, self._tick)

    def _tick(self) -> None:
        readers = self._readers()
        if readers > self._last_readers:
            self._forget()
        self._last_readers = readers
        if readers:
            self._read_at = self._monotonic()
            self._send()
        elif self._monotonic() - self._read_at >= self._timeout:
            self.stop(f"no client took the feedback for {self._timeout:g} s")

    def stop(self, reason: str = "") -> None:
        """End the stream. No-op if it has ended."""
        self._timer.cancel()
        on_end, self._on_end = self._on_end, None
        if on_end is not None:
            self.reason = reason
            on_end()


CPU_FRACTION: Final = 0.25
"""Fraction of the event loop's time for all streams together: a client may ask for a thousand frames a
hundred times a second, and other clients must be served, too."""

_NEWEST: Final = 0.2
"""Weight of the last turn in the moving average of its duration: one delayed turn must not slow a stream."""


@dataclass(eq=False)
class CpuBudget:
    """CPU budget of one stream: it pauses after each turn to stay within its part of :data:`CPU_FRACTION`.

    Args:
        monotonic: returns the seconds of the robot's clock.
        worked: returns the CPU seconds of this thread.
    """

    monotonic: Callable[[], float]
    streams: Callable[[], int]
    worked: Callable[[], float] = thread_time
    _usual: float = field(default=0.0, init=False)
    _rests_until: float = field(default=float("-inf"), init=False)

    def turn(self, work: Callable[[], None]) -> None:
        """Run `work`, unless the stream pauses."""
        now = self.monotonic()
        if now < self._rests_until:
            return
        began = self.worked()
        work()
        self._usual += _NEWEST * (self.worked() - began - self._usual)
        self._rests_until = now + self._usual * self.streams() / CPU_FRACTION
