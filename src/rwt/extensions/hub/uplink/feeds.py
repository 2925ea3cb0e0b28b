"""Feeds of a robot: samples that cross the uplink once, for all clients that want them."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from time import time_ns
from typing import TYPE_CHECKING, Final, NamedTuple

from rwt.extensions.hub.uplink.frames import (
    NO_STREAM,
    SMALL_BYTES,
    DropCause,
    Drops,
    FeedHead,
    Join,
    Lane,
    encode_feed,
    encode_join,
    encode_leave,
    encode_sample,
)
from rwt_protocol.frames import Burst, Frame, GapFrame
from rwt_transports.data_lane import DataLane, TopicQueue
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, FlowRules
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from rwt.extensions.hub.uplink.streams import Stream
    from rwt.extensions.hub.uplink.uplink import Uplink

MAX_FEEDS: Final = 4096
"""Maximum number of feeds of an uplink."""

MAX_MEMBERSHIPS: Final = 1024
"""Maximum number of feeds of one stream."""

MAX_CHANGES: Final = 4 * MAX_MEMBERSHIPS
"""Maximum number of changes of one stream's memberships that wait to be sent."""

CAUSES: Final = {
    DropCause.QUEUE: DropReason.QUEUE,
    DropCause.BACKLOG: DropReason.BACKLOG,
    DropCause.SIZE: DropReason.SIZE,
}


class _Announcement(NamedTuple):
    """Frame about a feed, and the stream whose membership it changes."""

    frame: bytes
    stream: Stream | None


class _FeedQueue(TopicQueue):
    """Queue of a feed."""

    __slots__ = ("feed",)

    def __init__(self, feed: Feed, on_drop: Callable[[DropReason], None], time_ns: Callable[[], int]) -> None:
        super().__init__(AS_MANY_AS_FIT, on_drop, time_ns)
        self.feed = feed


class _Sending:
    """Frame of a sample, of which a part was sent.

    Attributes:
        gap: position of the gap; None without one.
        ends: True if it is the last frame of its sample.
    """

    __slots__ = ("at", "binary", "data", "ends", "feed", "gap", "to")

    def __init__(self, feed: Feed, frame: Frame, to: int | None) -> None:
        self.feed = feed
        self.to = to
        self.gap = len(frame.parts[0]) if isinstance(frame, GapFrame) else None
        self.data = memoryview(frame.data)
        self.binary = frame.binary
        self.ends = not feed.queue.begun
        self.at = 0


@dataclass(slots=True, eq=False)
class FeedMember:
    """Membership of a stream in a feed; implements :class:`rwt_transports.endpoint.Membership`.

    Attributes:
        rules: rules of the client's queue at the hub.
        on_drop: called for each sample that the client did not get.
        own: frames that were sent to this client only, without those reported as dropped, and without the
            common ones from before it joined.
    """

    feed: Feed
    stream: Stream
    rules: FlowRules
    gap: str
    on_drop: Callable[[DropReason], None] | None
    apart: bool = True
    own: int = 0
    _told: Join | None = None
    _throttle: float = 0.0
    _queue: int = 0

    def wish(self, throttle: float, queue: int, *, apart: bool) -> None:
        """See :class:`~rwt_transports.endpoint.Membership`."""
        self._throttle, self._queue, self.apart = throttle, queue, apart
        self._tell()

    def configure(self, rules: FlowRules) -> None:
        """Change the rules of the client's queue."""
        self.feed.count(self.rules, -1)
        self.rules = rules
        self.feed.count(rules, +1)
        if self._told is not None:
            self._tell()

    def _tell(self) -> None:
        rules = self.rules
        join = Join(
            self.feed.number,
            self._throttle,
            self._queue,
            rules.depth,
            rules.keep_all,
            self.gap,
            self.apart,
        )
        if join != self._told:
            self._told = join
            self.feed.announce(encode_join(self.stream.number, join), self.stream)

    def send(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Send a sample to this client only."""
        self.feed.add(pieces, expires_ns, self.stream.number)

    def leave(self) -> None:
        """See :class:`~rwt_transports.endpoint.Membership`."""
        self.feed.remove(self)


class Feed:
    """Samples of one topic in one form; implements :class:`rwt_transports.endpoint.Feed`.

    Attributes by purpose:

    * ``number``, ``topic``, ``members`` (by stream), ``common`` (frames so far that were sent for all).
    * Queue: ``queue``, ``_receivers`` (of each sample in it: a stream, or None for all), ``_rules`` (number
      of members with each); ``_is_sending`` (True while a sample is being sent), ``_receiver`` (of that one).
    * Order: announcements go between the samples before and after them. ``_added``, ``_gone`` (samples so
      far that were queued, and that have left the queue), ``_announcements`` (with the value of ``_added`` at
      their time).
    """

    def __init__(
        self, feeds: Feeds, number: int, topic: str, key: Hashable, time_ns: Callable[[], int]
    ) -> None:
        self.number = number
        self.topic = topic
        self.key = key
        self.members: dict[int, FeedMember] = {}
        self.common = 0
        self.queue = _FeedQueue(self, self._dropped, time_ns)
        self._feeds = feeds
        self._receivers: deque[int | None] = deque()
        self._receiver: int | None = None
        self._is_sending = False
        self._rules: Counter[FlowRules] = Counter()
        self._added = self._gone = 0
        self._announcements: deque[tuple[int, _Announcement]] = deque()

    def set_period(self, seconds: float) -> None:
        """See :class:`~rwt_transports.endpoint.Feed`."""
        self.announce(encode_feed(self.number, FeedHead(self.topic, seconds)))

    def send(self, frame: Frame) -> None:
        """Queue a sample for all members."""
        self.add((frame,), 0, None)

    def join(self, burst: Burst) -> bool:
        """Return False: frames are sent separately."""
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Queue a sample for all members."""
        self.add(pieces, expires_ns, None)

    def configure(self, rules: FlowRules) -> None:
        """No-op: the rules are those of the members."""

    def close(self) -> None:
        """No-op: a feed ends with its last member."""

    def add(self, pieces: Sequence[Frame], expires_ns: int, to: int | None) -> None:
        """Queue a sample for one member, or for all."""
        if any(frame.size > self._feeds.outgoing_bytes for frame in pieces):
            self._lost(DropReason.SIZE, to)
            return
        self._added += 1
        self._receivers.append(to)
        self._feeds.add(self, pieces, expires_ns)

    def begin(self, frame: Frame) -> _Sending:
        """Begin to send a frame that was taken from the queue."""
        if not self._is_sending:
            self._receiver = self._receivers.popleft()
            self._gone += 1
            self._is_sending = True
        if self._receiver is None:
            self.common += 1
        elif self._receiver in self.members:
            self.members[self._receiver].own += 1
        return _Sending(self, frame, self._receiver)

    def sent(self) -> None:
        """Note that a sample was sent."""
        self._is_sending = False
        self._proceed()

    @property
    def _is_idle(self) -> bool:
        return self._added == self._gone and not self._is_sending

    def _proceed(self) -> None:
        """Announce what was to follow samples that have been sent or dropped."""
        while self._announcements and self._announcements[0][0] <= self._gone and not self._is_sending:
            self._feeds.announce(self._announcements.popleft()[1])
        self._end_if_unused()

    def announce(self, frame: bytes, stream: Stream | None = None) -> None:
        """Send a frame behind the samples that are queued now.

        Args:
            stream: stream whose membership it changes. With too many of them waiting, it ends.
        """
        announcement = _Announcement(frame, stream)
        if stream is not None:
            stream.changes += 1
            if stream.changes > MAX_CHANGES:
                stream.close(POLICY, f"more than {MAX_CHANGES} changes of subscriptions wait to be sent")
        if self._is_idle:
            self._feeds.announce(announcement)
        else:
            self._announcements.append((self._added, announcement))

    def count(self, rules: FlowRules, by: int) -> None:
        """Count a member with these rules; the loosest ones apply to the feed."""
        self._rules[rules] += by
        if not self._rules[rules]:
            del self._rules[rules]
        depths = [rules.depth for rules in self._rules]
        depth = None if None in depths else max((each for each in depths if each is not None), default=None)
        self._feeds.configure(self, FlowRules(depth, any(rules.keep_all for rules in self._rules)))

    def remove(self, member: FeedMember) -> None:
        """Remove a member, which still gets what is queued. The feed ends with the last one."""
        stream = member.stream
        if self.members.pop(stream.number, None) is None:
            return
        self.count(member.rules, -1)
        stream.memberships -= 1
        if not stream.is_over:
            self.announce(encode_leave(stream.number, self.number), stream)
        self._end_if_unused()

    def _end_if_unused(self) -> None:
        if not self.members and self._is_idle:
            self._feeds.end(self)

    def _dropped(self, reason: DropReason) -> None:
        self._gone += 1
        self._lost(reason, self._receivers.popleft())
        self._proceed()

    def _lost(self, reason: DropReason, to: int | None) -> None:
        receivers = self.members.values() if to is None else filter(None, (self.members.get(to),))
        # A copy: a callback may end a membership.
        for member in tuple(receivers):
            if member.on_drop is not None and (to is not None or not member.apart):
                self._feeds.drops[reason] += 1
                member.on_drop(reason)


class Feeds:
    """All feeds of a robot's uplink, in the lanes `SMALL` and `LARGE`: one sample at a time in each.

    Attributes:
        drops: samples that clients did not get, here or at the hub, by reason.

    Attributes by purpose: ``_by_key``, ``_by_number``, ``_count`` (number of the newest feed); ``_data``
    (queues), ``_sending`` (by lane), ``_announcements`` (ready to be sent).
    """

    number: Final = 0

    def __init__(self, uplink: Uplink) -> None:
        self._uplink = uplink
        self.outgoing_bytes = uplink.limits.outgoing_bytes
        self.drops = Counter[DropReason]()
        self._by_key: dict[Hashable, Feed] = {}
        self._by_number: dict[int, Feed] = {}
        self._count = 0
        self._data = DataLane(uplink.limits)
        self._sending: dict[Lane, _Sending] = {}
        self._announcements: deque[_Announcement] = deque()

    def __len__(self) -> int:
        return len(self._by_key)

    def demand(self) -> Counter[str]:
        """Return the number of clients of each topic."""
        clients = Counter[str]()
        for feed in self._by_key.values():
            clients[feed.topic] += len(feed.members)
        return clients

    def enter(
        self,
        stream: Stream,
        topic: str,
        key: Hashable,
        gap: bytes,
        rules: FlowRules,
        on_drop: Callable[[DropReason], None] | None,
        time_ns: Callable[[], int] = time_ns,
    ) -> FeedMember | None:
        """Return a new member of the feed of that key; None if there is no place for it."""
        feed = self._by_key.get(key)
        if stream.memberships >= MAX_MEMBERSHIPS or (feed is None and len(self) >= MAX_FEEDS):
            return None
        if feed is None:
            self._count += 1
            feed = Feed(self, self._count, topic, key, time_ns)
            self._by_key[key] = self._by_number[self._count] = feed
            feed.set_period(0.0)
        elif stream.number in feed.members:
            return None
        member = feed.members[stream.number] = FeedMember(
            feed, stream, rules, gap.hex(), on_drop, own=-feed.common
        )
        feed.count(rules, +1)
        stream.memberships += 1
        return member

    def end(self, feed: Feed) -> None:
        """End a feed that has neither members nor samples."""
        self.announce(_Announcement(encode_leave(NO_STREAM, feed.number), None))
        del self._by_key[feed.key], self._by_number[feed.number]

    def add(self, feed: Feed, pieces: Sequence[Frame], expires_ns: int) -> None:
        """Queue a sample of a feed."""
        queue = feed.queue
        self._data.add(queue, pieces, expires_ns)
        self._uplink.ready(self, Lane.SMALL if queue.next_size() <= SMALL_BYTES else Lane.LARGE)

    def configure(self, feed: Feed, rules: FlowRules) -> None:
        """Change the rules of a feed's queue."""
        feed.queue.rules = rules
        if rules.depth is not None:
            self._data.cut(feed.queue, max(rules.depth, 1))

    def announce(self, announcement: _Announcement) -> None:
        """Send a frame before the samples that are queued."""
        self._announcements.append(announcement)
        self._uplink.ready(self, Lane.SMALL)

    def _announced(self) -> bytes:
        frame, stream = self._announcements.popleft()
        if stream is not None:
            stream.changes -= 1
        return frame

    def dropped(self, drops: Drops) -> None:
        """Report samples that a client did not get at the hub, at most as many as were sent to it."""
        feed = self._by_number.get(drops.feed)
        member = None if feed is None else feed.members.get(drops.stream)
        if feed is None or member is None:
            return
        count = min(drops.samples, feed.common + member.own)
        member.own -= count
        self.drops[CAUSES[drops.cause]] += count
        for _ in range(count):
            if member.on_drop is not None:
                member.on_drop(CAUSES[drops.cause])

    def take(self, lane: Lane, most: int) -> bytes | None:
        """Return the next frame of a lane, with at most `most` bytes of payload; None if there is none."""
        if self._announcements:
            return self._announced()
        sending = self._sending.pop(lane, None) or self._next(lane)
        if self._announcements:
            # Samples before this one have expired, and something was to follow them.
            if sending is not None:
                self._sending[lane] = sending
            return self._announced()
        if sending is None:
            return None
        is_first = not sending.at
        part = sending.data[sending.at : sending.at + most]
        sending.at += len(part)
        is_last = sending.at >= len(sending.data)
        frame = encode_sample(
            sending.feed.number,
            lane,
            part,
            binary=sending.binary,
            is_last=is_last,
            to=sending.to if is_first else None,
            gap=sending.gap if is_first else None,
        )
        if not is_last:
            self._sending[lane] = sending
        elif sending.ends:
            sending.feed.sent()
        return frame

    def _next(self, lane: Lane) -> _Sending | None:
        other = self._sending.get(Lane.LARGE if lane is Lane.SMALL else Lane.SMALL)
        busy = None if other is None else other.feed.queue
        found = self._data.next_within(SMALL_BYTES if lane is Lane.SMALL else None, busy)
        if found is None:
            if lane is Lane.SMALL and self._data.messages:
                self._uplink.ready(self, Lane.LARGE)  # Behind a small one in its queue.
            return None
        queue, frame = found
        if lane is Lane.LARGE and frame.size <= SMALL_BYTES:
            self._uplink.ready(self, Lane.SMALL)
        assert isinstance(queue, _FeedQueue)
        return queue.feed.begin(frame)

    def taken(self) -> None:
        """No-op: nobody waits for feeds."""
