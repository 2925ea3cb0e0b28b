"""Retained samples of transient-local publishers in other processes, for subscribers that join later.

DDS does not announce how many samples a publisher retains. The number is found by a probe: a temporary
subscription, which receives what every late subscriber would. A publisher that no longer retains its first
sample has a known depth from then on, so a latched topic needs one probe.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from rwt.extensions.ros2.rcl import NO_NUMBER
from rwt_graph.api import Sample
from rwt_graph.backend import KEEP_ALL_LIMIT, TransientLocalCache
from rwt_graph.clock import Clock
from rwt_participant.qos import Durability, History, QoS, Reliability

#: Profile that receives everything that a transient-local publisher retains.
ALL_RETAINED = QoS(
    depth=KEEP_ALL_LIMIT, reliability=Reliability.RELIABLE, durability=Durability.TRANSIENT_LOCAL
)


class RemoteHistory(TransientLocalCache):
    """Samples that one publisher retains, as far as this process has received them.

    Attributes:
        newest: sequence number of the last sample; the first one that a publisher sends has 1.
    """

    def __init__(self, qos: QoS, clock: Clock) -> None:
        is_known = qos.depth > 0 or qos.history is History.KEEP_ALL
        super().__init__(qos if is_known else ALL_RETAINED, clock)
        self.newest = 0
        # Number from which a probe can find the depth: the first sample is always retained. With a lifespan,
        # samples are missing for another reason.
        self._next_probe = KEEP_ALL_LIMIT if is_known or qos.lifespan else 2

    def put(self, sample: Sample, number: int) -> None:
        """Keep a sample if it is newer than the last one."""
        if number == NO_NUMBER:
            self.add(sample)
        elif number > self.newest:
            self.newest = number
            self.add(sample)

    @property
    def wants_probe(self) -> bool:
        """True if the depth is unknown, and a probe may find it."""
        return self._next_probe <= self.newest < KEEP_ALL_LIMIT

    def probed(self, lowest: int) -> None:
        """Note the oldest sample that a late subscriber received while the publisher sent nothing."""
        if lowest == 1:
            self._next_probe = self.newest + max(1, self.newest // 4)
            return
        self._next_probe = KEEP_ALL_LIMIT
        kept = self.samples()
        self.clear()
        self._samples = deque(maxlen=self.newest - lowest + 1)
        for sample in kept:
            self.add(sample)


class Probe:
    """Samples that a temporary subscription receives from publishers of unknown depth.

    Args:
        histories: histories that want a probe, by GID.
    """

    def __init__(self, histories: Iterable[tuple[bytes, RemoteHistory]]) -> None:
        self._histories = dict(histories)
        self._newest = {gid: history.newest for gid, history in self._histories.items()}
        self._lowest: dict[bytes, int] = {}
        self._highest: dict[bytes, int] = {}

    def receive(self, gid: bytes, number: int) -> bool:
        """Note a sample; return True once the probe has received everything that it waits for."""
        if gid in self._histories:
            self._lowest.setdefault(gid, number)
            self._highest[gid] = number
        return all(self._highest.get(gid, 0) >= newest for gid, newest in self._newest.items())

    def finish(self) -> bool:
        """Note the results; returns False if a publisher has sent samples meanwhile."""
        is_complete = True
        for gid, history in self._histories.items():
            if self._highest.get(gid) == history.newest == self._newest[gid]:
                history.probed(self._lowest[gid])
            else:
                is_complete = False
        return is_complete
