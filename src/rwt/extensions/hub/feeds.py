"""Feeds of a robot at its hub: each sample arrives once, and goes to every client that wants it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

from msgspec import Struct

from rwt.delivery.counters import EncodingCounts
from rwt.delivery.fanout import DeferredSamples, EncodedStream
from rwt.delivery.feed_members import steps
from rwt.delivery.gap_flow import GapFlow
from rwt.delivery.throttle import Room, Throttle
from rwt.extensions.hub.uplink.assembly import Assembly
from rwt.extensions.hub.uplink.feeds import CAUSES, MAX_FEEDS, MAX_MEMBERSHIPS
from rwt.extensions.hub.uplink.frames import (
    MAX_DROPS,
    NO_STREAM,
    BadFrame,
    DropCause,
    Drops,
    FeedBegun,
    FeedFrame,
    FeedHead,
    Join,
    Joined,
    Lane,
    Left,
    SamplePart,
    encode_drops,
    split_first_part,
)
from rwt.extensions.hub.uplink.uplink import Uplink
from rwt_graph.clock import Clock
from rwt_protocol.frames import Frame, GapFrame
from rwt_transports.background import ignore
from rwt_transports.endpoint import DropReason, Flow, FlowRules, Sink
from rwt_transports.scheduler import Scheduler
from rwt_transports.shared_pool import Holder

if TYPE_CHECKING:
    from rwt.extensions.hub.uplink.streams import Stream

_KEPT_BYTES: Final = 400
"""Memory of a sample in a queue, beside its bytes."""

_MAX_REPORTS: Final = 256
"""Maximum number of reports of drops that wait to be sent."""

_CAUSE_OF: Final = {reason: cause for cause, reason in CAUSES.items()}


class _Arrived(Struct, frozen=True, eq=False, gc=False):
    """Sample as the robot has encoded it, and its own content.

    Implements :class:`rwt.delivery.throttle.Deliverable`.
    """

    frame: Frame
    stamp_ns: int = 0
    expires_ns: int = 0
    is_long: bool = False

    @property
    def payload(self) -> _Arrived:
        """Content."""
        return self

    @property
    def kept_size(self) -> int:
        """Bytes that keeping it takes, which are more than those of a small frame."""
        return self.frame.size + _KEPT_BYTES

    def prepare(self, forms: object) -> Iterator[None]:
        """No-op: it is encoded."""
        return iter(())


def _frame(sample: _Arrived) -> Frame:
    return sample.frame


class _Viewer:
    """Client that may be a member of feeds.

    Attributes:
        room: bytes that may wait in its throttles.
        feeds: numbers of the feeds that it is a member of.
    """

    __slots__ = ("feeds", "room", "sink")

    def __init__(self, sink: Sink, room: Room) -> None:
        self.sink = sink
        self.room = room
        self.feeds: set[int] = set()


class _Member:
    """Client in a feed.

    Attributes:
        flow: the client's flow, which fills the gaps of frames.
        throttle: throttle in front of it.
        join: what the client wants.
    """

    __slots__ = ("flow", "join", "throttle")

    def __init__(self, flow: Flow, throttle: Throttle, join: Join) -> None:
        self.flow = flow
        self.throttle = throttle
        self.join = join


class _Feed:
    """Feed of a robot.

    Attributes:
        members: members by the number of their stream.
        encoded: throttles of all members; those apart are muted.
    """

    def __init__(self, head: FeedHead, encoded: EncodedStream[_Arrived]) -> None:
        self.head = head
        self.members: dict[int, _Member] = {}
        self.encoded = encoded

    def begin(self, head: FeedHead) -> None:
        """Apply another period."""
        self.head = head
        for member in self.members.values():
            self.configure(member)
        self.encoded.arrange()

    def configure(self, member: _Member) -> None:
        """Let a member have what it wants of what arrives."""
        join, period = member.join, self.head.period
        member.flow.configure(FlowRules(join.depth, join.keep_all))
        if join.apart:
            member.throttle.flush()
        member.throttle.mute(join.apart)
        if not period:
            member.throttle.configure(join.throttle, join.queue)
        elif steps(join.throttle, period) <= 1:
            member.throttle.configure(0.0, 0)
        else:
            # Half a period less, because samples arrive a little sooner or later than they were sent.
            member.throttle.configure((steps(join.throttle, period) - 0.5) * period, join.queue)

    def send_to(self, stream: int, frame: Frame, now: float) -> None:
        """Send a sample to one member, behind what was sent to all."""
        member = self.members.get(stream)
        if member is not None:
            self.encoded.end_burst()
            member.flow.send(frame)
            member.throttle.note_sent(now)


class _Sending(NamedTuple):
    """What the first part of a sample says about it."""

    feed: int
    to: int | None
    gap: int | None


class RobotFeeds:
    """Feeds of one robot, and the clients that are their members.

    Attributes by purpose: ``_viewers`` (by stream), ``_feeds`` (by number); ``_assembly`` and ``_begun``
    (samples of which a part has arrived, by lane); ``_drops`` (not reported yet: by stream, feed and cause).

    Args:
        uplink: uplink of the robot.
        holder: the robot, to which incomplete samples are charged.
        clock: clock of the throttles.
        scheduler: scheduler of the hub's messages.
    """

    def __init__(self, uplink: Uplink, holder: Holder, clock: Clock, scheduler: Scheduler) -> None:
        self.bytes = 0
        self._uplink = uplink
        self._holder = holder
        self._clock = clock
        self._late = DeferredSamples(scheduler)
        self._viewers: dict[int, _Viewer] = {}
        self._feeds: dict[int, _Feed] = {}
        self._assembly = Assembly(uplink.limits.message_bytes)
        self._begun: dict[Lane, _Sending] = {}
        self._drops: Counter[tuple[int, int, DropCause]] = Counter()

    def __len__(self) -> int:
        return len(self._feeds)

    # -- clients ---------------------------------------------------------------------------------------------

    def admit(self, stream: int, sink: Sink) -> None:
        """Note the connection of the client of a stream."""
        self._viewers[stream] = _Viewer(sink, Room(self._uplink.limits.data_bytes))

    def ended(self, stream: Stream) -> None:
        """Remove the client of a stream from all feeds."""
        viewer = self._viewers.pop(stream.number, None)
        for number in viewer.feeds if viewer is not None else ():
            self._remove(stream.number, number)

    # -- frames of the robot ---------------------------------------------------------------------------------

    def receive(self, frame: FeedFrame) -> None:
        """Process a frame; raises BadFrame."""
        if isinstance(frame, SamplePart):
            self._sample(frame)
        elif isinstance(frame, Joined):
            self._join(frame.stream, frame.join)
        elif isinstance(frame, Left):
            self._leave(frame.stream, frame.feed)
        else:
            self._begin(frame)

    def _begin(self, frame: FeedBegun) -> None:
        feed = self._feeds.get(frame.feed)
        if feed is not None:
            feed.begin(frame.head)
            return
        if len(self._feeds) >= MAX_FEEDS:
            raise BadFrame(f"more than {MAX_FEEDS} feeds")
        encoded = EncodedStream(_frame, EncodingCounts(), self._clock, self._late)
        self._feeds[frame.feed] = _Feed(frame.head, encoded)

    def _join(self, stream: int, join: Join) -> None:
        feed, viewer = self._feeds.get(join.feed), self._viewers.get(stream)
        if feed is None:
            raise BadFrame(f"JOIN of feed {join.feed}, which was not begun")
        if viewer is None:
            return  # It has left meanwhile.
        member = feed.members.get(stream)
        is_new = member is None
        if member is None:
            if len(viewer.feeds) >= MAX_MEMBERSHIPS:
                raise BadFrame(f"stream {stream} is a member of more than {MAX_MEMBERSHIPS} feeds")
            member = self._member(stream, join, feed, viewer)
            viewer.feeds.add(join.feed)
            feed.members[stream] = member
        member.join = join
        feed.configure(member)
        if is_new:
            feed.encoded.add(member.throttle)
        else:
            feed.encoded.changed(member.throttle)

    def _member(self, stream: int, join: Join, feed: _Feed, viewer: _Viewer) -> _Member:
        on_drop = partial(self._dropped, stream, join.feed)
        flow: Flow = viewer.sink.flow(feed.head.topic, on_drop=on_drop, time_ns=self._clock.time_ns)
        if join.gap:
            flow = GapFlow(flow, bytes.fromhex(join.gap))
        return _Member(flow, Throttle(self._clock, flow, ignore, on_drop, viewer.room), join)

    def _leave(self, stream: int, number: int) -> None:
        if stream == NO_STREAM:
            feed = self._feeds.get(number)
            for each in tuple(feed.members) if feed is not None else ():
                self._leave(each, number)
            self._feeds.pop(number, None)
            return
        viewer = self._viewers.get(stream)
        if viewer is not None and number in viewer.feeds:
            viewer.feeds.discard(number)
            self._remove(stream, number)

    def _remove(self, stream: int, number: int) -> None:
        """Remove a member. The feed stays until the robot ends it, who may already have added another one."""
        feed = self._feeds[number]
        member = feed.members.pop(stream, None)
        if member is None:
            return
        member.throttle.close()
        member.flow.close()
        feed.encoded.remove(member.throttle)
        for cause in DropCause:
            self._drops.pop((stream, number, cause), None)

    # -- samples ---------------------------------------------------------------------------------------------

    def _sample(self, part: SamplePart) -> None:
        payload = part.payload
        begun = self._begun.get(part.lane)
        if begun is None:
            to, gap, payload = split_first_part(part)
            begun = _Sending(part.feed, to, gap)
        elif begun.feed != part.feed:
            raise BadFrame(f"a part of feed {part.feed} in the middle of a sample of feed {begun.feed}")
        whole = self._assembly.add(part.lane, payload, is_last=part.is_last)
        self._assembly.hold(self._uplink.buffers, self, self._holder)
        if not part.is_last:
            self._begun[part.lane] = begun
            return
        self._begun.pop(part.lane, None)
        feed = self._feeds.get(part.feed)
        if feed is None or whole is None:
            return
        self.bytes += whole.size
        if not whole.is_complete:
            for stream, member in feed.members.items():
                if begun.to == stream or (begun.to is None and not member.join.apart):
                    self._dropped(stream, part.feed, DropReason.SIZE)
            return
        frame = _framed(whole.data, begun.gap, feed, binary=part.binary)
        if begun.to is None:
            feed.encoded.deliver(_Arrived(frame))
        else:
            feed.send_to(begun.to, frame, self._clock.monotonic())

    def give_up(self, reason: str) -> None:
        """Drop the incomplete samples, which take too much of what all share."""
        self._assembly.give_up()

    # -- drops -----------------------------------------------------------------------------------------------

    def _dropped(self, stream: int, feed: int, reason: DropReason) -> None:
        cause = _CAUSE_OF.get(reason)
        if cause is not None:
            self._drops[stream, feed, cause] += 1

    def report(self) -> None:
        """Tell the robot which samples its clients did not get, as far as it takes the reports.

        The rest is counted until the next call: there may be as many as memberships, and the robot may be
        slow.
        """
        if not self._uplink.is_carried:
            return
        for _ in range(min(len(self._drops), _MAX_REPORTS - self._uplink.waiting_orders)):
            stream, feed, cause = key = next(iter(self._drops))
            count = self._drops.pop(key)
            now = min(count, MAX_DROPS)
            self._uplink.order(encode_drops(Drops(stream, feed, cause, now)))
            if count > now:
                self._drops[key] = count - now  # Behind the others.


def _framed(data: bytes, gap: int | None, feed: _Feed, *, binary: bool) -> Frame:
    if gap is None:
        return Frame(data, binary=binary)
    if gap > len(data):
        raise BadFrame(f"a gap at {gap} in a sample of {len(data)} bytes")
    own = next((len(member.join.gap) // 2 for member in feed.members.values()), 0)
    return GapFrame(data[:gap], own, memoryview(data)[gap:], binary=binary)
