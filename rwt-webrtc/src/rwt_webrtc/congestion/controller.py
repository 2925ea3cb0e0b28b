"""Congestion controller: the rate at which a sender may send, from what a receiver reports.

Based on draft-ietf-rmcat-gcc-02: the delay gradient lowers the rate, loss limits it, and probes raise it. A
receiver without transport-wide feedback reports an estimate of its own (REMB).
"""

from __future__ import annotations

import math
from typing import Final

from rwt_protocol.states import StateEnum
from rwt_webrtc.congestion.delay import OveruseDetector, QueueDelay, Usage
from rwt_webrtc.congestion.feedback import Feedback
from rwt_webrtc.congestion.packets import LossWindow, ReceivedRate, SentPackets
from rwt_webrtc.congestion.probes import SETTLE_SECONDS, Probe, Prober

DECREASE: Final = 0.85
"""Part of the received rate to which overuse lowers the rate."""
INCREASE: Final = 1.08
"""Growth per second far from the capacity of the link."""
NEAR_INCREASE: Final = 24_000
"""Growth per second close to the capacity, in bits per second."""
NEAR: Final = 0.15
"""Relative distance from the capacity that counts as close."""
HEADROOM: Final = 1.5
"""Maximum ratio of the rate to the received one for it to grow."""
IDLE: Final = 0.65
"""Part of the rate below which the sender has too little to send to learn from it."""
LEAST_DECREASE: Final = 0.7
"""Least factor of a decrease while the queue is short: less of an idle sender arrives than could."""
SHORT_QUEUE_SECONDS: Final = 0.1
DECREASE_SECONDS: Final = 0.3
"""Time until the effect of a decrease shows."""
LEAST_QUEUE_SECONDS: Final = 0.025
"""Standing queue without which growing delay is no overuse: bursts and busy receivers cause it, too."""
QUEUE_SECONDS: Final = 0.06
"""Standing queue above which less is sent, so that it drains."""
LONG_QUEUE_SECONDS: Final = 0.25
"""Standing queue that counts as overuse, however slowly it grew."""
DRAIN: Final = 1.5
"""Reduction of the rate per second of the queue."""
LEAST_DRAIN: Final = 0.1
SILENCE_SECONDS: Final = 0.6
"""Time without feedback after which the link counts as lost."""
NOTICE_SECONDS: Final = 0.05
"""Time for which the silence has to last after it was noticed: feedback may be waiting in a busy process."""
OUTAGE_FACTOR: Final = 0.5
"""Factor of the rate after an outage."""
OUTAGE_PROBE_SECONDS: Final = 1.0
"""Time from the end of an outage to the next probe."""
LOSS: Final = 0.1
"""Excess loss above which the rate is lowered."""
DRAINED_SECONDS: Final = 0.005
"""Standing queue that counts as none."""


class _State(StateEnum):
    ESTIMATED = "REPORTED", "AWAITING"
    REPORTED = "REPORTED", "AWAITING"
    AWAITING = "REPORTED", "AWAITING", "LATE"
    LATE = "REPORTED", "AWAITING", "SILENT"
    SILENT = "REPORTED", "AWAITING"


class CongestionController:
    """Rate of one sender.

    State of the feedback::

        ESTIMATED ── first report ──> REPORTED ── sent() ──> AWAITING ── 0.6 s ──> LATE ── 0.05 s ──> SILENT
                                         ^                      │                   │                  │
                                         └── acknowledged() ────┴───────────────────┴──────────────────┘

    * **ESTIMATED**: without transport-wide feedback, the receiver's own estimates (REMB) set the rate.
    * **REPORTED**: everything that was sent is reported, so no feedback is due.
    * **AWAITING**: packets are under way. A report about some of them leads here as well.
    * **LATE**: feedback is overdue, but may be waiting in a busy process.
    * **SILENT**: the link counts as lost, and the least rate is sent until it is back.

    Attributes by purpose:

    * Rate: ``_target``, ``_least``, ``_most``, ``_updated_at``, ``_decreased_at``, ``_is_in_doubt`` (the last
      decrease may have been for a short stall).
    * Feedback: ``_state``, ``_since`` (time of the last change of state), ``_sent`` (packets without report).
    * Link: ``_detector`` (trend of the delay), ``_queue`` (standing queue), ``_received``, ``_loss``,
      ``_capacity`` (received rate during overuse; None if unknown), ``_growth_s`` (seconds by which the queue
      grows with what is in flight).
    * Probes: ``_prober``.

    Args:
        start: first rate.
        least: minimum rate.
        most: maximum rate: that of the best encoding.
        now: time in seconds of a steady clock, as in all methods.
    """

    def __init__(self, start: float, least: float, most: float, now: float) -> None:
        self._target = min(max(start, least), most)
        self._least, self._most = least, most
        self._updated_at = now
        self._decreased_at = now - DECREASE_SECONDS
        self._is_in_doubt = False
        self._state = _State.ESTIMATED
        self._since = now
        self._sent = SentPackets()
        self._detector = OveruseDetector()
        self._queue = QueueDelay()
        self._received = ReceivedRate()
        self._loss = LossWindow(now)
        self._capacity: float | None = None
        self._growth_s = 0.0
        self._prober = Prober(now)

    def _become(self, state: _State, now: float) -> None:
        self._state, self._since = self._state.become(state), now

    @property
    def target(self) -> float:
        """Estimated share of the link, in bits per second."""
        return self._target

    @property
    def has_feedback(self) -> bool:
        """True if the receiver has given transport-wide feedback."""
        return self._state is not _State.ESTIMATED

    def rate(self, now: float) -> float:
        """Return the bits per second to send now: less than the target while a queue drains or the receiver
        is silent.
        """
        if self._is_silent(now):
            return self._least
        drain = 1 - DRAIN * max(0.0, self._expected_queue_s - QUEUE_SECONDS)
        return max(self._least, self._target * max(LEAST_DRAIN, drain))

    @property
    def _expected_queue_s(self) -> float:
        return self._queue.seconds + self._growth_s

    def _is_silent(self, now: float) -> bool:
        if self._state is _State.AWAITING and now - self._since > SILENCE_SECONDS:
            self._become(_State.LATE, now)
        elif self._state is _State.LATE and now - self._since >= NOTICE_SECONDS:
            self._become(_State.SILENT, now)
        return self._state is _State.SILENT

    # -- the sender's side ---------------------------------------------------------------------------------

    def sent(self, size: int, now: float, probe: Probe | None = None) -> int:
        """Count a packet; returns its transport-wide number."""
        number = self._sent.add(size, now)
        if probe is not None:
            probe.sent[number] = (now, size)
        if self._state is _State.REPORTED:
            self._become(_State.AWAITING, now)
        return number

    def next_probe(self, now: float) -> Probe | None:
        """Return the probe to send now; None for none."""
        if (
            not self._prober.is_due(now)
            or self._target >= self._most
            or self._is_silent(now)
            or self._queue.seconds > QUEUE_SECONDS
            or now - self._decreased_at < SETTLE_SECONDS
        ):
            return None
        return self._prober.begin(self._target, self._most, now)

    # -- the receiver's side -------------------------------------------------------------------------------

    def estimated(self, bits: float, now: float) -> None:
        """Handle the receiver's own estimate (REMB), which counts only without transport-wide feedback."""
        if self._state is _State.ESTIMATED:
            self._target = min(max(bits, self._least), self._most)

    def acknowledged(self, feedback: Feedback, now: float) -> None:
        """Handle transport-wide feedback."""
        was_silent = self._is_silent(now)
        count = self._count_arrivals(feedback, now)
        self._become(_State.AWAITING if self._sent else _State.REPORTED, now)
        self._close_loss_window(now)
        if was_silent and feedback.arrivals.count(None) > LOSS * len(feedback.arrivals):
            # An outage says little about the capacity: continue with half of the rate, and probe soon. A busy
            # receiver is silent, too, but has lost nothing.
            self._lower(OUTAGE_FACTOR * self._target, now)
            self._prober.schedule(now + OUTAGE_PROBE_SECONDS)
        elif count:
            self._adapt(now)
        self._updated_at = now

    def _count_arrivals(self, feedback: Feedback, now: float) -> int:
        """Measure the link by the packets that have arrived; returns their number."""
        count, newest = 0, -math.inf
        for number, sent, arrived, size in self._sent.arrivals(feedback, now):
            count += 1
            newest = max(newest, sent)
            self._detector.add(sent, arrived)
            self._queue.add(sent, arrived)
            self._received.add(arrived, size)
            self._prober.arrived(number, sent, arrived, size)
        self._loss.add(count, self._sent.remove_lost(now))
        if count:
            # In balance, what is in flight takes as long as the newest packet took that has arrived. After a
            # cut of the link it takes longer, which shows before it arrives.
            in_flight_s = 8 * self._sent.bytes_after(newest) / self._received.delivery_bits
            self._growth_s = max(0.0, in_flight_s - (now - newest))
        found = self._prober.found(self._target, now)
        if found is not None:
            self._capacity = None
            self._raise(found)
        return count

    def _adapt(self, now: float) -> None:
        received = self._received.bits
        long_queue = self._queue.seconds > LONG_QUEUE_SECONDS
        is_overused = self._detector.usage is Usage.OVERUSED and self._queue.seconds > LEAST_QUEUE_SECONDS
        if is_overused or long_queue:
            if now - self._decreased_at >= DECREASE_SECONDS and not self._is_probing(now):
                if self._growth_s > LONG_QUEUE_SECONDS:
                    # The cut is more recent than what is counted.
                    received = min(received, self._received.delivery_bits)
                self._capacity = received
                self._is_in_doubt = not long_queue
                is_short = self._expected_queue_s < SHORT_QUEUE_SECONDS
                self._lower(max(DECREASE * received, LEAST_DECREASE * self._target * is_short), now)
            return
        if self._is_in_doubt and now - self._decreased_at >= SETTLE_SECONDS:
            # A queue of a full link drains slowly. One that has vanished was a short stall of a radio link.
            self._is_in_doubt = False
            if self._queue.seconds < DRAINED_SECONDS:
                self._prober.schedule(now)
        if self._detector.usage is Usage.UNDERUSED or received < IDLE * self._target:
            return
        seconds = min(now - self._updated_at, 1.0)
        if self._capacity is not None and received > (1 + NEAR) * self._capacity:
            self._capacity = None  # The link carries more than it did.
        if self._capacity is not None and self._target > (1 - NEAR) * self._capacity:
            raised = self._target + NEAR_INCREASE * seconds
        else:
            raised = self._target * INCREASE**seconds
        self._raise(min(raised, HEADROOM * received + 10_000))

    def _is_probing(self, now: float) -> bool:
        # The queue of a probe is its own, and drains soon.
        return now - self._prober.began_at < SETTLE_SECONDS and self._queue.seconds < SHORT_QUEUE_SECONDS

    def _lower(self, target: float, now: float) -> None:
        if target < self._target:
            self._target = max(target, self._least)
            self._decreased_at = now
            self._prober.delay(now)

    def _raise(self, target: float) -> None:
        self._target = min(max(self._target, target), self._most)

    def _close_loss_window(self, now: float) -> None:
        window = self._loss.close(now)
        if window is None:
            return
        fraction, inherent = window
        if fraction - inherent > LOSS:
            self._capacity = self._received.bits
            self._lower(min(self._target * (1 - 0.5 * fraction), 0.95 * self._received.bits), now)
