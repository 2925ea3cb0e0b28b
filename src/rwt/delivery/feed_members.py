"""Clients behind one line, such as the uplink to a hub: what all of them want crosses it once."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from functools import partial
from typing import Final, NamedTuple

from rwt.delivery.throttle import Room, Throttle
from rwt_graph.clock import Clock
from rwt_transports.background import ignore
from rwt_transports.endpoint import Feed, Membership

TOLERANCE: Final = 1.05
"""Maximum factor by which a member's samples may be further apart than it asked for."""

_MAX_DIVISOR: Final = 4


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
    # The far end cannot tell how many of them would have been queued.
    if any(wish.queue > 1 for wish in wishes):
        return EVERY_SAMPLE
    shortest = min(wish.throttle for wish in wishes)
    for divisor in range(1, _MAX_DIVISOR + 1):
        period = shortest / divisor
        if all(steps(wish.throttle, period) * period <= TOLERANCE * wish.throttle for wish in wishes):
            return Wish(period, max(wish.queue for wish in wishes))
    return EVERY_SAMPLE


def steps(throttle: float, period: float) -> int:
    """Return the number of periods after which a throttle lets the next sample pass."""
    return math.ceil(throttle / period - 1e-6)


class _Service(Enum):
    """How samples reach a member: through its own throttle here, or through that of the line.

    It is JOINING while the line's throttle has samples queued that are older than its subscription. It gets
    those behind them in common with the others.
    """

    APART = auto()
    JOINING = auto()
    SHARED = auto()


@dataclass(slots=True, eq=False)
class _Member:
    """Member of a feed.

    Attributes:
        wish: None if only its own throttle gives what it wants.
    """

    membership: Membership
    wish: Wish | None
    service: _Service


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
        """Add a member, or apply what it asks for now.

        Args:
            waits: True while samples are encoded that are older than its subscription.
        """
        self._count(throttle, -1)
        member = self._members.get(throttle)
        wish = None if throttle.asked is None else Wish(*throttle.asked)
        if wish is None or waits:
            member = _Member(membership, wish, _Service.APART)
            self.apart[throttle] = None
            self.line.forget(throttle)
        elif member is None or member.service is _Service.APART:
            member = _Member(membership, wish, _Service.JOINING)
            self.apart.pop(throttle, None)
            throttle.flush()
        is_new = self._members.get(throttle) is not member
        self._members[throttle] = member
        member.wish = wish
        self._count(throttle, +1)
        if is_new and member.service is _Service.JOINING:
            self.line.call_behind(throttle, partial(self._share, member))
        if not self._arrange():
            self._tell(member)

    def remove(self, throttle: Throttle) -> None:
        """Remove a member."""
        self._count(throttle, -1)
        self._members.pop(throttle).membership.leave()
        self.apart.pop(throttle, None)
        self.line.forget(throttle)
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
        for member in self._members.values():
            self._tell(member)
        return True

    def _share(self, member: _Member) -> None:
        """Let a member have the samples of the line."""
        member.service = _Service.SHARED
        self._tell(member)

    def _tell(self, member: _Member) -> None:
        wish = member.wish or EVERY_SAMPLE
        member.membership.wish(wish.throttle, wish.queue, apart=member.service is not _Service.SHARED)
