"""Telling a client what did not reach it, and why: one line per topic and second at the most."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from rwt_protocol.transport import DropReason, FlowRules

if TYPE_CHECKING:
    from rwt_bridge.peer import Peer
    from rwt_delivery.counters import TopicCounts
    from rwt_graph.clock import Timer
    from rwt_protocol.transport import Flow

TELL_SECONDS: Final = 1.0
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


class Losses:
    """The samples of one topic that one client did not get.

    What a client wanted dropped (`throttle_rate`) is counted and not told. The rest is: after a second, in
    one `status` that gives the count since the subscription began. It goes through a flow of depth one, so
    that a client which reads nothing is owed one line and not one for each second.
    """

    def __init__(self, peer: Peer, topic: str, counts: TopicCounts) -> None:
        self._peer = peer
        self._topic = topic
        self._counts = counts
        self._total: dict[DropReason, int] = {}
        self._deadlines = 0
        self._untold: set[str] = set()
        self._timer: Timer | None = None
        self._lines: Flow | None = None
        self._logged = float("-inf")

    def withheld(self, reason: DropReason) -> None:
        """The gate kept a sample back, as the client asked."""
        self._counts.drop(reason)

    def dropped(self, reason: DropReason) -> None:
        """A sample was lost on its way to the client."""
        self._counts.drop(reason)
        self._total[reason] = self._total.get(reason, 0) + 1
        self._tell(reason)

    def deadline_missed(self) -> None:
        """No sample came within the time that the client expects one in."""
        self._deadlines += 1
        self._peer.bridge.ledger.missed_deadlines += 1
        self._tell("deadline")

    def close(self) -> None:
        """Tell nothing more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._lines is not None:
            self._lines.close()

    def _tell(self, what: str) -> None:
        self._untold.add(what)
        if self._timer is None:
            self._timer = self._peer.bridge.graph.clock.call_later(TELL_SECONDS, self._report)

    def _report(self) -> None:
        self._timer = None
        text = "; ".join([f"{self._topic}: {self._reason(what)}" for what in sorted(self._untold)])
        self._untold.clear()
        now = self._peer.bridge.graph.clock.monotonic()
        if now - self._logged >= LOG_SECONDS:
            self._logged = now
            self._peer.log(logging.INFO, text)
        frame = self._peer.warning(text)
        if frame is None:
            return
        if self._lines is None:
            self._lines = self._peer.sink.flow(f"status of {self._topic}", FlowRules(depth=1, notes=True))
        self._lines.send(frame)

    def _reason(self, what: str) -> str:
        if what == "deadline":
            return f"the deadline was missed {_times(self._deadlines)}"
        reason = DropReason(what)
        count = self._total[reason]
        return f"{count} message{'s' if count > 1 else ''} dropped since the subscription: {_BECAUSE[reason]}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
