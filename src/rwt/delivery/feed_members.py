"""Clients behind one line, such as the uplink to a hub: what all of them want crosses it once."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from rwt.delivery.throttle import Room, Throttle
from rwt_graph.clock import Clock
from rwt_transports.background import ignore
from rwt_transports.endpoint import Feed, Membership

TOLERANCE: Final = 1.05
"""Maximum factor by which a member's samples may be further apart than it asked for."""

_MAX_DIVISOR: Final = 4
_MAX_APART: Final = 8
"""Maximum number of members with a wish that only a throttle of their own gives."""


class Wish(NamedTuple):
    """What a client asked for: minimum seconds between samples, and samples that wait for that."""

    throttle: float
    queue: int

    @property
    def is_open(self) -> bool:
        """True for all samples."""
        return not self.throttle


EVERY_SAMPLE: Final = Wish(0.0, 0)


def serving(wishes: Mapping[Wish, int]) -> Wish:
    """Return the sparsest throttle of a line from which the far end can serve the members.

    Args:
        wishes: number of members with each wish.
    """
    if not wishes or any(wish.is_open for wish in wishes):
        return EVERY_SAMPLE
    if len(wishes) == 1:
        return next(iter(wishes))
    fitting = [wish for wish in wishes if wish.queue <= 1]
    if len(wishes) - len(fitting) and sum(n for wish, n in wishes.items() if wish.queue > 1) > _MAX_APART:
        return EVERY_SAMPLE
    shortest = min((wish.throttle for wish in fitting), default=0.0)
    for divisor in range(1, _MAX_DIVISOR + 1):
        period = shortest / divisor
        if period and all(
            steps(wish.throttle, period) * period <= TOLERANCE * wish.throttle for wish in fitting
        ):
            return Wish(period, max(wish.queue for wish in fitting))
    return EVERY_SAMPLE


def steps(throttle: float, period: float) -> int:
    """Return the number of periods after which a throttle lets the next sample pass."""
    return math.ceil(throttle / period - 1e-6)


def fits(wish: Wish, line: Wish) -> bool:
    """Return True if a member can be served from what crosses the line."""
    return line.is_open or wish == line or (wish.queue <= 1 and line.queue <= 1)


@dataclass(slots=True)
class _Member:
    """Member of a feed.

    Attributes:
        wish: None if only its own throttle gives what it wants.
        waits: True until samples have been delivered that are older than its subscription.
    """

    membership: Membership
    wish: Wish | None
    waits: bool


class FeedMembers:
    """Members of one feed.

    Most are served by one throttle in common, ``line``, and at the far end by one each. Those ``apart`` have
    their own throttle here, and get samples that are for them alone.

    Attributes:
        line: throttle of the line.
        apart: throttles of the members that are served here.
    """

    def __init__(self, feed: Feed, clock: Clock) -> None:
        # Its queue has one sample, or as many as each member has asked for, which those could keep as well.
        self.line = Throttle(clock, feed, ignore, ignore, Room(2**62))
        self.apart: dict[Throttle, None] = {}
        self._feed = feed
        self._members: dict[Throttle, _Member] = {}
        self._wishes: Counter[Wish] = Counter()
        self._serving = EVERY_SAMPLE

    def __len__(self) -> int:
        return len(self._members)

    @property
    def throttles(self) -> tuple[Throttle, ...]:
        """Throttles that samples must be offered to."""
        if len(self.apart) == len(self._members):
            return tuple(self.apart)
        return (self.line, *self.apart)

    def put(self, throttle: Throttle, membership: Membership, *, waits: bool = False) -> None:
        """Add a member, or apply what it asks for now."""
        self._count(throttle, -1)
        asked = throttle.asked
        self._members[throttle] = _Member(membership, None if asked is None else Wish(*asked), waits)
        self._count(throttle, +1)
        if not self._arrange():
            self._tell(throttle)

    def remove(self, throttle: Throttle) -> None:
        """Remove a member."""
        self._count(throttle, -1)
        self._members.pop(throttle).membership.leave()
        self.apart.pop(throttle, None)
        if self._members:
            self._arrange()
        else:
            self.line.close()

    def _count(self, throttle: Throttle, by: int) -> None:
        member = self._members.get(throttle)
        if member is not None and member.wish is not None:
            self._wishes[member.wish] += by
            if not self._wishes[member.wish]:
                del self._wishes[member.wish]

    def _arrange(self) -> bool:
        """Choose the throttle of the line. Returns False if it is as before."""
        chosen = serving(self._wishes)
        if chosen == self._serving:
            return False
        self._serving = chosen
        self.line.configure(*chosen)
        self._feed.set_period(chosen.throttle)
        for throttle in self._members:
            self._tell(throttle)
        return True

    def _tell(self, throttle: Throttle) -> None:
        member = self._members[throttle]
        wish = member.wish
        apart = wish is None or member.waits or not fits(wish, self._serving)
        if apart:
            self.apart[throttle] = None
        else:
            self.apart.pop(throttle, None)
        chosen = wish or EVERY_SAMPLE
        member.membership.wish(chosen.throttle, chosen.queue, apart=apart)
