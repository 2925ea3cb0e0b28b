"""Congestion controller: the rate at which a sender may send, from what a receiver reports.

Based on draft-ietf-rmcat-gcc-02: the delay gradient lowers the rate, loss limits it, and probes raise it. A
receiver without transport-wide feedback reports an estimate of its own (REMB).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice, takewhile
from typing import Final

from rwt_webrtc.transport.congestion.delay import OveruseDetector, QueueDelay, Usage
from rwt_webrtc.transport.congestion.feedback import REFERENCE_SECONDS, REFERENCES, Feedback

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
RECEIVED_SECONDS: Final = 0.5
LEAST_QUEUE_SECONDS: Final = 0.025
"""Standing queue without which growing delay is no overuse: bursts and busy receivers cause it, too."""
QUEUE_SECONDS: Final = 0.06
"""Standing queue above which less is sent, so that it drains."""
LONG_QUEUE_SECONDS: Final = 0.25
"""Standing queue that counts as overuse, however slowly it grew."""
DELIVERIES: Final = 8
"""Number of the last arrivals whose rate is that at which the link delivers."""
DRAIN: Final = 1.5
"""Reduction of the rate per second of the queue."""
LEAST_DRAIN: Final = 0.1
SILENCE_SECONDS: Final = 0.6
"""Time without feedback after which the link counts as lost."""
NOTICE_SECONDS: Final = 0.05
"""Time for which that has to last after it was noticed."""
LOSS_SECONDS: Final = 1.0
LOSS: Final = 0.1
"""Excess loss above which the rate is lowered."""
LOSS_PACKETS: Final = 20
LOSS_WINDOWS: Final = 5
LATE_SECONDS: Final = 0.3
"""Time after which a packet that was reported missing counts as lost: packets overtake each other."""
MOST_LOSS: Final = 0.3
"""Loss of the link itself that does not lower the rate, at most."""
HISTORY: Final = 4096
PROBE_SECONDS: Final = 0.05
PROBE_PACKETS: Final = 6
PROBE_FACTOR: Final = 2.0
PROBE_LIMIT: Final = 1.25
"""Maximum rate of a probe, as a multiple of the maximum rate."""
PROBE_WAIT_SECONDS: Final = 4.0
MOST_PROBE_WAIT_SECONDS: Final = 8.0
PROBE_TIMEOUT_SECONDS: Final = 2.0
PROBE_LOSS: Final = 0.2
SATURATED: Final = 0.9
"""Ratio of the received to the sent rate of a probe below which it has filled the link."""
DRAINED_SECONDS: Final = 0.005
"""Standing queue that counts as none."""
SETTLE_SECONDS: Final = 0.5
"""Time after a decrease or a probe before the next probe that follows a successful one."""


@dataclass(slots=True)
class Probe:
    """Burst of packets above the present rate.

    Attributes:
        rate: bits per second at which it is sent.
        size: bytes to send.
        began: time of its beginning.
        sent: departure and size of its packets, by number.
        arrived: departure, arrival and size of those that have arrived.
        is_complete: True if all of it was sent.
    """

    rate: float
    size: int
    began: float
    sent: dict[int, tuple[float, int]] = field(default_factory=dict)
    arrived: list[tuple[float, float, int]] = field(default_factory=list)
    is_complete: bool = False

    @property
    def count(self) -> int:
        return len(self.sent) + len(self.arrived)


class CongestionController:
    """Rate of one sender.

    * History: ``_history`` (packets without feedback), ``_missing`` (reported missing).
    * Receiver: ``_received`` (sizes by time of arrival), ``_capacity`` (received rate during overuse),
      ``_growth_s`` (seconds by which the queue grows with what is in flight).
    * Loss: ``_lost``, ``_delivered`` of the present window, ``_fractions`` of those before.
    * Probes: ``_probe`` (being sent or reported), ``_probe_at`` (time of the next), ``_is_in_doubt`` (the
      last decrease may have been for a short stall).

    Args:
        most: maximum rate: that of the best encoding.
        now: time in seconds of a steady clock, as in all methods.
    """

    def __init__(self, start: float, least: float, most: float, now: float) -> None:
        self._target = min(max(start, least), most)
        self._least, self._most = least, most
        self._number = 0
        self._history: dict[int, tuple[float, int]] = {}
        self._missing: dict[int, float] = {}
        self._detector = OveruseDetector()
        self._queue = QueueDelay()
        self._received: deque[tuple[float, int]] = deque()
        self._received_bytes = 0
        self._capacity: float | None = None
        self._growth_s = 0.0
        self._reference: int | None = None
        self._lost = self._delivered = 0
        self._fractions: deque[float] = deque([0.0] * LOSS_WINDOWS, maxlen=LOSS_WINDOWS)
        self._loss_at = now
        self._heard_at: float | None = None
        self._sent_at: float | None = None
        self._noticed_at: float | None = None
        self._updated_at = now
        self._decreased_at = now - DECREASE_SECONDS
        self._is_in_doubt = False
        self._probe: Probe | None = None
        self._probe_at = now
        self._probed_at = now - SETTLE_SECONDS
        self._probe_wait = PROBE_WAIT_SECONDS

    @property
    def target(self) -> float:
        """Estimated share of the link, in bits per second."""
        return self._target

    @property
    def queue_seconds(self) -> float:
        """Delay of the standing queue."""
        return self._queue.seconds

    @property
    def has_feedback(self) -> bool:
        """True if the receiver has given transport-wide feedback."""
        return self._heard_at is not None

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
        # Silence counts from the first packet after the last feedback: there is none about nothing.
        if self._sent_at is None or now - self._sent_at <= SILENCE_SECONDS:
            return False
        if self._noticed_at is None:
            self._noticed_at = now  # Feedback may be waiting, if this process was busy.
        return now - self._noticed_at >= NOTICE_SECONDS

    # -- the sender's side ---------------------------------------------------------------------------------

    def sent(self, size: int, now: float, probe: Probe | None = None) -> int:
        """Count a packet; returns its transport-wide number."""
        number = self._number
        self._number = (number + 1) % 65536
        self._history[number] = (now, size)
        if len(self._history) > HISTORY:
            self._history.pop(next(iter(self._history)))
        if probe is not None:
            probe.sent[number] = (now, size)
        if self._sent_at is None and self._heard_at is not None:
            self._sent_at = now
        return number

    def next_probe(self, now: float) -> Probe | None:
        """Return the probe to send now; None for none."""
        if self._probe is not None:
            if now - self._probe.began < PROBE_TIMEOUT_SECONDS:
                return None
            self._failed(now)
        if (
            now < self._probe_at
            or self._target >= self._most
            or self._is_silent(now)
            or self._queue.seconds > QUEUE_SECONDS
            or now - self._decreased_at < SETTLE_SECONDS
        ):
            return None
        rate = min(PROBE_FACTOR * self._target, PROBE_LIMIT * self._most)
        self._probed_at = now
        self._probe = Probe(rate, round(rate * PROBE_SECONDS / 8), now)
        return self._probe

    # -- the receiver's side -------------------------------------------------------------------------------

    def estimated(self, bits: float, now: float) -> None:
        """Handle the receiver's own estimate (REMB), which counts only without transport-wide feedback."""
        if self._heard_at is None:
            self._target = min(max(bits, self._least), self._most)

    def acknowledged(self, feedback: Feedback, now: float) -> None:
        was_silent = self._is_silent(now)
        self._noticed_at = None
        origin = self._origin(feedback.reference)
        arrivals = self._take(feedback.base, feedback.arrivals, origin, now)
        self._heard_at = now
        self._sent_at = now if self._history else None
        self._close_loss_window(now)
        if was_silent and feedback.arrivals.count(None) > LOSS * len(feedback.arrivals):
            # An outage says little about the capacity: continue with half of the rate, and probe soon. A busy
            # receiver is silent, too, but has lost nothing.
            self._lower(0.5 * self._target, now)
            self._probe_at = now + 1.0
        elif arrivals:
            self._adapt(now)
        self._updated_at = now

    def _origin(self, reference: int) -> float:
        """Return the seconds of a reference time, which is cyclic."""
        before = reference if self._reference is None else self._reference
        step = (reference - before + REFERENCES // 2) % REFERENCES - REFERENCES // 2
        self._reference = before + step
        return self._reference * REFERENCE_SECONDS

    def _take(self, base: int, arrivals: Sequence[float | None], origin: float, now: float) -> int:
        """Move packets from the history to what has arrived; returns their number."""
        found, newest = 0, -math.inf
        for offset, since in enumerate(arrivals):
            number = (base + offset) % 65536
            if number not in self._history:
                continue
            if since is None:
                self._missing.setdefault(number, now)
                continue
            sent, size = self._history.pop(number)
            self._missing.pop(number, None)
            arrived = origin + since
            found += 1
            newest = max(newest, sent)
            self._delivered += 1
            self._detector.add(sent, arrived)
            self._queue.add(sent, arrived)
            self._count_received(arrived, size)
            if self._probe is not None and self._probe.sent.pop(number, None) is not None:
                self._probe.arrived.append((sent, arrived, size))
        for number in [each for each, since in self._missing.items() if now - since > LATE_SECONDS]:
            del self._missing[number]
            if self._history.pop(number, None) is not None:
                self._lost += 1
        if found:
            self._growth_s = self._growth(newest, now)
        if self._probe is not None and self._probe.is_complete:
            self._judge(self._probe, now)
        return found

    def _growth(self, newest: float, now: float) -> float:
        """Return the seconds by which the queue grows with the packets after the newest that has arrived.

        In balance, what is in flight takes as long as that one took. After a cut of the link it takes longer,
        which shows before it arrives.
        """
        later = takewhile(lambda packet: packet[0] > newest, reversed(self._history.values()))
        return max(0.0, 8 * sum(size for _, size in later) / self._delivery_rate - (now - newest))

    @property
    def _delivery_rate(self) -> float:
        """Bits per second of the last arrivals; infinite if there are too few."""
        last = list(islice(reversed(self._received), DELIVERIES))
        times = [arrived for arrived, _ in last]
        seconds = max(times) - min(times)
        return (
            8 * sum(size for _, size in last) / seconds if len(last) == DELIVERIES and seconds else math.inf
        )

    def _count_received(self, arrived: float, size: int) -> None:
        received = self._received
        received.append((arrived, size))
        self._received_bytes += size
        while received[0][0] < arrived - RECEIVED_SECONDS:
            self._received_bytes -= received.popleft()[1]

    @property
    def received_rate(self) -> float:
        """Bits per second that have lately arrived."""
        return 8 * self._received_bytes / RECEIVED_SECONDS

    def _adapt(self, now: float) -> None:
        received = self.received_rate
        long_queue = self._queue.seconds > LONG_QUEUE_SECONDS
        is_overused = self._detector.usage is Usage.OVERUSED and self._queue.seconds > LEAST_QUEUE_SECONDS
        if is_overused or long_queue:
            if now - self._decreased_at >= DECREASE_SECONDS and not self._is_probing(now):
                if self._growth_s > LONG_QUEUE_SECONDS:
                    # The cut is more recent than what is counted.
                    received = min(received, self._delivery_rate)
                self._capacity = received
                self._is_in_doubt = not long_queue
                is_short = self._expected_queue_s < SHORT_QUEUE_SECONDS
                self._lower(max(DECREASE * received, LEAST_DECREASE * self._target * is_short), now)
            return
        if self._is_in_doubt and now - self._decreased_at >= SETTLE_SECONDS:
            # A queue of a full link drains slowly. One that has vanished was a short stall of a radio link.
            self._is_in_doubt = False
            if self._queue.seconds < DRAINED_SECONDS:
                self._probe_at = now
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
        return now - self._probed_at < SETTLE_SECONDS and self._queue.seconds < SHORT_QUEUE_SECONDS

    def _lower(self, target: float, now: float) -> None:
        if target < self._target:
            self._target = max(target, self._least)
            self._decreased_at = now
            self._probe_at = max(self._probe_at, now + self._probe_wait)

    def _raise(self, target: float) -> None:
        self._target = min(max(self._target, target), self._most)

    def _close_loss_window(self, now: float) -> None:
        count = self._lost + self._delivered
        if now - self._loss_at < LOSS_SECONDS or count < LOSS_PACKETS:
            return
        fraction = self._lost / count
        # What is lost at every rate is not congestion.
        inherent = min(*self._fractions, MOST_LOSS)
        self._fractions.append(fraction)
        self._lost = self._delivered = 0
        self._loss_at = now
        if fraction - inherent > LOSS:
            self._capacity = self.received_rate
            self._lower(min(self._target * (1 - 0.5 * fraction), 0.95 * self.received_rate), now)

    # -- probes --------------------------------------------------------------------------------------------

    def _judge(self, probe: Probe, now: float) -> None:
        """Evaluate a probe when most of its packets have arrived."""
        if len(probe.arrived) < max(PROBE_PACKETS - 1, (1 - PROBE_LOSS) * probe.count):
            return
        probe.arrived.sort()
        sent = probe.arrived[-1][0] - probe.arrived[0][0]
        times = [arrived for _, arrived, _ in probe.arrived]
        received = max(times) - min(times)
        bits = 8 * sum(size for _, _, size in probe.arrived)
        first, last = (8 * probe.arrived[each][2] for each in (0, -1))
        if sent <= 0 or received <= 0:
            self._failed(now)
            return
        send_rate, receive_rate = (bits - last) / sent, (bits - first) / received
        found = min(send_rate, receive_rate)
        if receive_rate < SATURATED * send_rate:
            found = SATURATED * receive_rate
        if found <= 1.1 * self._target:
            self._failed(now)
            return
        self._probe = None
        self._capacity = None
        self._probe_wait = PROBE_WAIT_SECONDS
        self._raise(found)
        is_saturated = receive_rate < SATURATED * send_rate
        self._probe_at = now + (self._probe_wait if is_saturated else SETTLE_SECONDS)

    def _failed(self, now: float) -> None:
        self._probe = None
        self._probe_at = now + self._probe_wait
        self._probe_wait = min(1.5 * self._probe_wait, MOST_PROBE_WAIT_SECONDS)
