"""What publishers of other processes kept, told once to each subscription.

The cache of a transient-local publisher is asked when it is found, and found it is again after every cut of
the link. Then it says again what was heard before, to subscriptions that have it and to those that came
meanwhile.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph.memory.topics import Kept

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rwt_graph.api import Sample
    from rwt_graph.clock import Clock
    from rwt_graph.memory.remote import RemoteEndpoint
    from rwt_program.qos import QoS

#: Publishers that a subscription remembers.
_MOST_REMEMBERED = 1000


class KeptElsewhere(Kept):
    """What is kept here of what a publisher elsewhere keeps, for whoever subscribes here next.

    Attributes:
        gid: the publisher's.
        last: the number of its last sample.
    """

    def __init__(self, qos: QoS, clock: Clock, gid: bytes) -> None:
        super().__init__(qos, clock)
        self.gid = gid
        self.last = -1

    def put(self, sample: Sample, number: int) -> None:
        """Keep a sample, unless it is."""
        if number > self.last:
            self.last = number
            self.add(sample)


class Told:
    """The numbers of the last samples that a subscription was given, by the GIDs of their publishers.

    Args:
        publishers: those whose kept samples the subscription was given when it was made.
    """

    __slots__ = ("_last",)

    def __init__(self, publishers: Iterable[RemoteEndpoint] = ()) -> None:
        kept = (publisher.kept for publisher in publishers)
        self._last = {each.gid: each.last for each in kept if isinstance(each, KeptElsewhere)}

    def is_new(self, gid: bytes, number: int) -> bool:
        """Whether a sample comes after the last one; it is the last one then."""
        if number <= self._last.get(gid, -1):
            return False
        self._last[gid] = number
        if len(self._last) > _MOST_REMEMBERED:
            del self._last[next(iter(self._last))]
        return True


__all__ = ["KeptElsewhere", "Told"]
