"""Notices to a client about dropped samples and missed deadlines: at most one per topic and second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rwt.delivery.counters import Counters, TopicCounts
from rwt_graph.clock import Clock
from rwt_participant.timers import Timer
from rwt_protocol.frames import Frame
from rwt_transports.endpoint import DropReason, Flow, FlowRules, Sink

NOTICE_SECONDS: Final = 1.0
LOG_SECONDS: Final = 60.0

_BECAUSE: Final = {
    DropReason.QUEUE: "more were waiting than the subscription's own queue holds; ask for a longer one, or "
    "for fewer messages with `throttle_rate`",
    DropReason.BACKLOG: "this connection is slower than what it is subscribed to; ask for fewer messages "
    "with `throttle_rate`, or for smaller ones with `compression`",
    DropReason.SIZE: "they were larger than `limits.outgoing_message_bytes`; ask for pieces with "
    "`fragment_size`, or for smaller ones with `compression`",
    DropReason.LIFESPAN: "they were older than their lifespan when their turn came",
}


class DropNotices:
    """Samples of one topic that one client did not get.

    Drops that a client requested (`throttle_rate`) are only counted. Others are reported: a second
    after the first drop, with the count since the subscription began.

    Args:
        topic: name in the client's spelling.
        describe: returns the text of a notice for a reason and a number of samples.
    """

    def __init__(
        self,
        topic: str,
        counts: TopicCounts,
        counters: Counters,
        clock: Clock,
        notify: Callable[[str], None],
        log: Callable[[str], None],
        describe: Callable[[DropReason, int], str] | None = None,
    ) -> None:
        self._describe = describe or _described
        self._topic = topic
        self._counts = counts
        self._counters = counters
        self._clock = clock
        self._notify = notify
        self._log = log
        self._total: dict[DropReason, int] = {}
        self._deadlines = 0
        self._unreported: set[str] = set()
        self._timer: Timer | None = None
        self._logged = float("-inf")
        self._last = ""  # Last notice, which is not repeated.

    def withheld(self, reason: DropReason) -> None:
        """Count a sample that the throttle dropped, as the client requested."""
        self._counts.drop(reason)

    def dropped(self, reason: DropReason) -> None:
        """Count a sample that was dropped, and report it."""
        self._counts.drop(reason)
        self._total[reason] = self._total.get(reason, 0) + 1
        self._schedule(reason)

    def deadline_missed(self) -> None:
        """Report a missed deadline of the subscription."""
        self._deadlines += 1
        self._counters.missed_deadlines += 1
        self._schedule("deadline")

    def close(self) -> None:
        """Stop reporting."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _schedule(self, what: str) -> None:
        self._unreported.add(what)
        if self._timer is None:
            self._timer = self._clock.call_later(NOTICE_SECONDS, self._report)

    def _report(self) -> None:
        self._timer = None
        text = "; ".join([f"{self._topic}: {self._reason(what)}" for what in sorted(self._unreported)])
        self._unreported.clear()
        now = self._clock.monotonic()
        if now - self._logged >= LOG_SECONDS:
            self._logged = now
            self._log(text)
        # The text contains the counts: the same text means that nothing was dropped since.
        if text != self._last:
            self._last = text
            self._notify(text)

    def _reason(self, what: str) -> str:
        if what == "deadline":
            return f"the deadline was missed {_times(self._deadlines)}"
        reason = DropReason(what)
        return self._describe(reason, self._total[reason])


def _described(reason: DropReason, count: int) -> str:
    return f"{count} message{'s' if count > 1 else ''} dropped since the subscription: {_BECAUSE[reason]}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


@dataclass(slots=True, eq=False)
class NoticeFlow:
    """Notices to one client about one topic, in a flow of depth one: at most one waits for a slow client."""

    sink: Sink
    topic: str
    _flow: Flow | None = None

    def send(self, frame: Frame) -> None:
        """Send a notice in place of a queued one."""
        if self._flow is None:
            self._flow = self.sink.flow(f"status of {self.topic}", FlowRules(depth=1, notes=True))
        self._flow.send(frame)

    def close(self) -> None:
        """Close the flow."""
        if self._flow is not None:
            self._flow.close()


SHORTEST: Final = 0.01
"""Minimum deadline in seconds; shorter ones count as this."""
SAME_MOMENT: Final = 1e-6
"""Tolerance of clock readings in seconds, because sums of floats round."""


class DeadlineWatch:
    """Watchdog that calls `on_missed` once for each period of `seconds` without a call of :meth:`met`."""

    __slots__ = ("_clock", "_last", "_on_missed", "_seconds", "_timer")

    def __init__(self, clock: Clock, seconds: float, on_missed: Callable[[], None]) -> None:
        self._clock = clock
        self._seconds = max(seconds, SHORTEST)
        self._on_missed = on_missed
        self._last = clock.monotonic()
        self._timer: Timer | None = clock.call_later(self._seconds, self._look)

    def met(self) -> None:
        """Note a message."""
        self._last = self._clock.monotonic()

    def close(self) -> None:
        """Stop watching."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self) -> None:
        now = self._clock.monotonic()
        left = self._last + self._seconds - now
        if left <= SAME_MOMENT:
            self._last = now
            left = self._seconds
            self._on_missed()
        if self._timer is not None:
            self._timer = self._clock.call_later(left, self._look)
