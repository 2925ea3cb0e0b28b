"""Simulated link: sender with a congestion controller, bottleneck and receiver, on a clock of its own."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import pairwise

from rwt_webrtc.congestion.controller import CongestionController
from rwt_webrtc.congestion.feedback import REFERENCE_SECONDS, Feedback
from rwt_webrtc.congestion.pacing import Pacer
from rwt_webrtc.congestion.probes import Probe

STEP = 0.001
HZ = 30
PACKET_BYTES = 1200
FEEDBACK_SECONDS = 0.1


@dataclass
class Link:
    """Properties of the simulated link.

    Attributes:
        bits: capacity in bits per second by time; 0 for a lost link.
        delay: seconds each way.
        jitter: largest additional delay; packets may overtake each other.
        loss: part of the packets that are lost.
        queue: seconds of the longest queue.
        cross: bits per second of other traffic by time.
        uses: part of the rate that the encoder uses, by time.
        stalled: True if the sender does nothing at a time: its event loop is busy.
        held_until: time at which packets arrive that would arrive at a given time: a busy receiver.
    """

    bits: Callable[[float], float]
    delay: float = 0.04
    jitter: float = 0.0
    loss: float = 0.0
    queue: float = 1.0
    cross: Callable[[float], float] = lambda now: 0.0
    uses: Callable[[float], float] = lambda now: 1.0
    stalled: Callable[[float], bool] = lambda now: False
    held_until: Callable[[float], float] = lambda now: 0.0


@dataclass
class Run:
    """Record of a run, by time."""

    rates: list[tuple[float, float]] = field(default_factory=list)
    targets: list[tuple[float, float]] = field(default_factory=list)
    frames: list[tuple[float, float]] = field(default_factory=list)
    """Arrival and age of each complete frame."""

    def rate(self, begin: float, end: float) -> float:
        """Return the mean rate."""
        found = [rate for now, rate in self.rates if begin <= now < end]
        return sum(found) / len(found)

    def targets_of(self, begin: float, end: float) -> list[float]:
        return [rate for now, rate in self.targets if begin <= now < end]

    def pause(self, begin: float, end: float) -> float:
        """Return the longest time without a frame."""
        times = [begin, *(now for now, _ in self.frames if begin <= now < end), end]
        return max(after - before for before, after in pairwise(times))

    def ages(self, begin: float, end: float) -> list[float]:
        return sorted(age for now, age in self.frames if begin <= now < end)


class Simulation:
    """Sender, link and receiver."""

    def __init__(self, link: Link, most: float = 2e6, start: float = 5e5, seed: int = 1) -> None:
        self.controller = CongestionController(start, 50_000, most, 0.0)
        self._link = link
        self._pacer = Pacer()
        self._random = random.Random(seed)
        self._outgoing: deque[tuple[int, float | None]] = deque()  # size, creation time of a frame's last
        self._probe: Probe | None = None
        self._backlog_bits = 0.0
        self._flying: list[tuple[float, int, int, float | None]] = []
        self._feedback: list[tuple[float, int, Feedback]] = []
        self._arrived: dict[int, float] = {}
        self._next_report = 0  # number of the next packet to report
        self._sent = 0
        self._now = 0.0
        self._frame_at = 0.0
        self._report_at = 0.0
        self._sent_bits = 0

    def run(self, seconds: float) -> Run:
        run = Run()
        noted = 0.0
        until = self._now + seconds
        while self._now < until:
            self._now += STEP
            if not self._link.stalled(self._now):
                self._produce()
                self._send()
            self._carry(run)
            self._report()
            if self._now >= noted + 0.1:
                run.rates.append((self._now, self._sent_bits / 0.1))
                run.targets.append((self._now, self.controller.target))
                self._sent_bits, noted = 0, self._now
        return run

    def _produce(self) -> None:
        """Encode a frame if it is due and the pacer has room."""
        now = self._now
        rate = self.controller.rate(now)
        if now < self._frame_at or self._outgoing or self._probe is not None:
            return
        if self._pacer.frame_delay(rate, now) > 0:
            return
        self._probe = self.controller.next_probe(now)
        self._frame_at = max(self._frame_at + 1 / HZ, now)
        size = round(rate * self._link.uses(now) / HZ / 8 * self._random.uniform(0.7, 1.3))
        while size > PACKET_BYTES:
            self._outgoing.append((PACKET_BYTES, None))
            size -= PACKET_BYTES
        self._outgoing.append((max(size, 50), now))

    def _send(self) -> None:
        now = self._now
        while self._pacer.packet_delay(now) <= 0:
            rate = self.controller.rate(now)
            probe = self._probe
            if probe is not None:
                self._put(PACKET_BYTES, None, probe)
                self._pacer.sent(PACKET_BYTES, rate, now, probe.rate)
                if sum(size for _, size in probe.sent.values()) >= probe.size and len(probe.sent) >= 6:
                    probe.is_complete, self._probe = True, None
            elif self._outgoing:
                size, made = self._outgoing.popleft()
                self._put(size, made, None)
                self._pacer.sent(size, rate, now)
            else:
                return

    def _put(self, size: int, made: float | None, probe: Probe | None) -> None:
        now, link = self._now, self._link
        self._sent_bits += 8 * size
        self.controller.sent(size, now, probe)
        number, self._sent = self._sent, self._sent + 1
        bits = link.bits(now)
        if not bits or self._backlog_bits / bits > link.queue or self._random.random() < link.loss:
            return
        self._backlog_bits += 8 * size
        arrives = now + self._backlog_bits / bits + link.delay + self._random.uniform(0, link.jitter)
        heappush(self._flying, (max(arrives, link.held_until(arrives)), number, size, made))

    def _carry(self, run: Run) -> None:
        now, link = self._now, self._link
        share = max(0.0, link.bits(now) - link.cross(now))
        self._backlog_bits = max(0.0, self._backlog_bits - share * STEP)
        while self._flying and self._flying[0][0] <= now:
            arrives, number, _, made = heappop(self._flying)
            self._arrived[number] = arrives
            if made is not None:
                run.frames.append((now, now - made))

    def _report(self) -> None:
        """Report what has arrived, as libwebrtc does: lost ones are reported again if they arrive later."""
        now = self._now
        if now >= self._report_at:
            self._report_at = now + FEEDBACK_SECONDS
            if self._arrived:
                first, last = min(*self._arrived, self._next_report), max(self._arrived)
                # A clock of its own: more than a reference period ahead of the sender's.
                reference = int(min(self._arrived.values()) / REFERENCE_SECONDS)
                times = tuple(
                    None if number not in self._arrived
                    else self._arrived[number] - reference * REFERENCE_SECONDS
                    for number in range(first, last + 1)
                )  # fmt: skip
                feedback = Feedback(first % 65536, reference + 1000, times)
                self._next_report = max(last + 1, self._next_report)
                self._arrived.clear()
                if self._link.bits(now):
                    heappush(self._feedback, (now + self._link.delay, self._sent, feedback))
        while self._feedback and self._feedback[0][0] <= now and not self._link.stalled(now):
            self.controller.acknowledged(heappop(self._feedback)[2], now)
