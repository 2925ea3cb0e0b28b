"""Samples that cross an uplink once for all clients: from the robot's fan-out to the clients of the hub."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from rwt.delivery.counters import EncodingCounts
from rwt.delivery.fanout import DeferredSamples, EncodedStream
from rwt.delivery.gap_flow import GapFlow
from rwt.delivery.throttle import Room, Throttle
from rwt.extensions.hub.feeds import RobotFeeds
from rwt.extensions.hub.uplink.dial import UplinkStatus
from rwt.extensions.hub.uplink.feeds import MAX_CHANGES, MAX_FEEDS
from rwt.extensions.hub.uplink.frames import (
    SMALL_BYTES,
    BadFrame,
    DropCause,
    Drops,
    FeedHead,
    Join,
    Lane,
    SamplePart,
    decode_frame,
    encode_ack,
    encode_drops,
    encode_feed,
    encode_join,
    encode_leave,
    encode_sample,
    is_sequenced,
)
from rwt.extensions.hub.uplink.streams import Stream
from rwt.extensions.hub.uplink.uplink import Uplink
from rwt_graph import SimulatedClock
from rwt_protocol.frames import Burst, Frame, GapFrame
from rwt_transports import Limits
from rwt_transports.background import ignore
from rwt_transports.data_lane import DataLane, TopicQueue
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, Endpoint, Flow, FlowRules, Traffic
from rwt_transports.scheduler import MESSAGES, Budget, Scheduler
from rwt_transports.shared_pool import Holder
from rwt_transports.wires.receive_buffer import Incomplete, ReceiveBufferPool
from tests.call_counts import count_calls

LIMITS = Limits(message_bytes=1_000_000, data_bytes=400_000)
ROBOT = Holder("192.0.2.9", "")


class Content(NamedTuple):
    """Content of a sample that is encoded at once."""

    is_long: bool
    kept_size: int

    def prepare(self, forms: object) -> Iterator[None]:
        return iter(())


@dataclass(frozen=True)
class Sample:
    """Sample of a robot."""

    number: int
    size: int = 10
    stamp_ns: int = 0
    expires_ns: int = 0
    is_long: bool = False

    @property
    def payload(self) -> Content:
        return Content(self.is_long, self.size)


def encoded(sample: Sample) -> Frame:
    return Frame(b"%d" % sample.number + b" " * sample.size)


def numbered(sample: Sample) -> Frame:
    """Return a frame with a gap behind its first byte."""
    return GapFrame(b"#", 2, b"%d" % sample.number + b" " * sample.size, binary=True)


@dataclass(eq=False)
class Screen:
    """Connection of a viewer at the hub, which keeps what it gets.

    Attributes:
        stalls: True while it drops everything, as one that reads nothing.
    """

    frames: list[bytes] = field(default_factory=list)
    rules: FlowRules = AS_MANY_AS_FIT
    stalls: bool = False
    on_drop: Callable[[DropReason], None] = ignore
    received = backlog = 0
    traffic = Traffic()

    @property
    def numbers(self) -> list[int]:
        """Numbers of the samples."""
        return [int(frame.strip(b"# ")) for frame in self.frames]

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = lambda: 0,
    ) -> Flow:
        self.on_drop = on_drop or ignore
        return self

    def send(self, frame: Frame) -> None:
        self.send_message((frame,))

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        if self.stalls:
            self.on_drop(DropReason.BACKLOG)
        else:
            self.frames += (frame.data for frame in pieces)

    def join(self, burst: Burst) -> bool:
        return False

    def configure(self, rules: FlowRules) -> None:
        self.rules = rules

    def close(self, code: int = 1000, reason: str = "") -> None:
        self.on_drop = ignore

    def hand_over(self, endpoint: Endpoint) -> None:
        raise AssertionError("not expected")

    def count_for(self, holder: Holder) -> None:
        raise AssertionError("not expected")


class Several(Screen):
    """Connection of a viewer with several topics, which drops everything."""

    def flow(self, *given: Any, **named: Any) -> Flow:
        screen = Screen(stalls=True)
        screen.flow(*given, **named)
        return screen


class Peer:
    """Endpoint of a client at the robot."""

    def receive(self, data: bytes, binary: bool) -> None:
        raise AssertionError("clients say nothing here")

    def __init__(self) -> None:
        self.on_end: Callable[[], None] = ignore

    def closed(self, code: int, reason: str) -> None:
        self.on_end()


@dataclass(eq=False)
class Viewer:
    """Client of the robot behind the hub."""

    number: int
    screen: Screen
    stream: Stream
    throttle: Throttle
    flow: Flow
    drops: list[DropReason]


class Pool(ReceiveBufferPool):
    """Pool that knows who holds how many bytes."""

    def __init__(self, most: int) -> None:
        super().__init__(most)
        self.sizes: dict[Holder, int] = {}

    def hold(self, receiver: Incomplete, size: int, holder: Holder) -> None:
        self.sizes[holder] = size
        super().hold(receiver, size, holder)

    def release(self, receiver: Incomplete) -> None:
        self.sizes.clear()
        super().release(receiver)


class Link:
    """A robot and a hub, one topic, and viewers. Frames in flight are kept in order.

    Attributes:
        crossed: samples that have crossed, as often as they did.
    """

    def __init__(
        self,
        encode: Callable[[Sample], Frame] = encoded,
        limits: Limits = LIMITS,
        clock: SimulatedClock | None = None,
    ) -> None:
        self.clock = clock or SimulatedClock()
        self.pool = Pool(4_000_000)
        self.at_robot: dict[int, Stream] = {}
        self.peers: dict[int, Peer] = {}
        self.hub = Uplink(
            "s",
            limits,
            self.pool,
            lambda: None,
            repeats=False,
            closed=lambda stream: self.feeds.ended(stream),
            fed=lambda frame: self.feeds.receive(frame),
        )
        self.feeds = RobotFeeds(self.hub, ROBOT, self.clock, Scheduler.immediate(MESSAGES))
        self.robot = Uplink("s", limits, self.pool, lambda: None, repeats=True, opened=self._opened)
        turns: list[Callable[[], None]] = []
        no_time = Budget(turn=0.0, share=-1.0, steps=0.0)
        self.late = DeferredSamples(Scheduler(no_time, turns.append, lambda _, call: turns.append(call)))
        self.topic: EncodedStream[Sample] = EncodedStream(encode, EncodingCounts(), self.clock, self.late)
        self.to_robot: deque[bytes] = deque()
        self.to_hub: deque[bytes] = deque()
        self.crossed = 0
        self.connect()

    @property
    def now(self) -> float:
        return self.clock.monotonic()

    def _opened(self, stream: Stream, opening: bytes) -> None:
        self.at_robot[stream.number] = stream
        self.peers[stream.number] = Peer()
        stream.begin(self.peers[stream.number])

    def open(self) -> Stream:
        """Return the stream of a new client."""
        stream = self.hub.open(b"{}", "192.0.2.1")
        stream.begin(Peer())
        self.settle()
        return stream

    def view(
        self,
        throttle: float = 0.0,
        queue: int = 0,
        own: bytes = b"",
        piece: int = 0,
        rules: FlowRules = AS_MANY_AS_FIT,
        stream: Stream | None = None,
    ) -> Viewer:
        """Return a viewer that has subscribed: a new client, or one with that stream."""
        stream = stream or self.open()
        screen, drops = Screen(), list[DropReason]()
        number = self.admit(stream, screen)
        flow: Flow = self.at_robot[number].flow("/topic", rules, on_drop=drops.append)
        if own:
            flow = GapFlow(flow, own)
        gate = Throttle(self.clock, flow, ignore, drops.append, Room(1_000_000))
        gate.configure(throttle, queue)
        gate.cut_to(piece)
        self.topic.add(gate)
        viewer = Viewer(number, screen, stream, gate, flow, drops)
        self.peers[number].on_end = partial(self.leave, viewer)
        return viewer

    def admit(self, stream: Stream, screen: Screen) -> int:
        """Let a client have samples. Returns the number of its stream at the robot."""
        self.feeds.admit(stream.number, screen)
        return stream.number

    def hang_up(self, viewer: Viewer) -> None:
        """End the connection of a client at the hub; the robot hears of it later."""
        self.end(viewer.stream)

    def end(self, stream: Stream) -> None:
        """End a stream at the hub."""
        stream.close()
        self.feeds.ended(stream)

    def leave(self, viewer: Viewer) -> None:
        """End a subscription."""
        self.peers[viewer.number].on_end = ignore
        viewer.throttle.close()
        viewer.flow.close()
        self.topic.remove(viewer.throttle)

    def publish(self, *numbers: int, size: int = 10) -> None:
        for number in numbers:
            self.topic.deliver(Sample(number, size))

    def connect(self) -> None:
        assert self.hub.carried(self.robot.received, self.now)
        assert self.robot.carried(self.hub.received, self.now)

    def cut(self) -> None:
        self.to_robot.clear()
        self.to_hub.clear()
        self.hub.lost(self.now)
        self.robot.lost(self.now)

    def send(self, most: int = 1_000_000) -> None:
        self.to_robot += self.hub.take(most, self.now)
        self.to_hub += self.robot.take(most, self.now)

    def arrive(self, frames: int) -> None:
        for _ in range(frames):
            if self.to_robot:
                self.robot.receive(self.to_robot.popleft(), self.now)
            if self.to_hub:
                data = self.to_hub.popleft()
                frame = decode_frame(data)
                self.crossed += isinstance(frame, SamplePart) and frame.is_last
                self.hub.receive(data, self.now)

    @property
    def is_settled(self) -> bool:
        """True if nothing is under way."""
        return not (self.to_robot or self.to_hub or self.hub.has_more or self.robot.has_more)

    def settle(self) -> None:
        """Let everything arrive."""
        for _ in range(10_000):
            self.clock.advance(0.0001)
            self.send()
            if self.is_settled:
                return
            self.arrive(1000)
        raise AssertionError("it does not settle")

    def run(self, seconds: float, rate: float) -> None:
        """Publish at that rate."""
        began = self.now
        for number in range(int(seconds * rate)):
            self.publish(number)
            self.settle()
            self.clock.advance(began + (number + 1) / rate - self.now)


def test_drops_of_very_many_memberships_are_reported_as_fast_as_the_robot_takes_them() -> None:
    link, streams, topics = Link(), 20, 1000
    for feed in range(1, topics + 1):
        link.hub.receive(encode_feed(feed, FeedHead(f"/topic{feed}")), link.now)
    for _ in range(streams):
        stream = link.hub.open(b"{}", "192.0.2.1")
        stream.begin(Peer())
        link.feeds.admit(stream.number, Several())
        for feed in range(1, topics + 1):
            link.hub.receive(encode_join(stream.number, Join(feed)), link.now)
    for feed in range(1, topics + 1):
        sample = encode_sample(feed, Lane.SMALL, memoryview(b"1"), binary=False, is_last=True)
        link.hub.receive(sample, link.now)
    reported = arrived = 0
    for _ in range(streams * topics):
        link.feeds.report()
        link.feeds.report()
        sent = link.hub.take(3000, link.now)
        link.clock.advance(0.01)
        arrived += sum(len(frame) for frame in sent if is_sequenced(frame))
        link.hub.receive(encode_ack(arrived), link.now)  # Raises if too many answers wait.
        reported += sum(isinstance(decode_frame(frame), Drops) for frame in sent)
        if reported == streams * topics:
            return
    raise AssertionError(f"{reported} reports")


class Chain(Link):
    """A robot, its home node, and another node, `far`, which has the clients.

    Attributes:
        near: streams at the home node, by those at the other one.
    """

    def __init__(self, limits: Limits = LIMITS) -> None:
        self.far: Link | None = None
        super().__init__(limits=limits)
        self.far = Link(limits=limits, clock=self.clock)
        self.near: dict[int, Stream] = {}

    def _links(self) -> tuple[Link, ...]:
        return () if self.far is None else (self.far,)

    def open(self) -> Stream:
        assert self.far is not None
        near, stream = super().open(), self.far.open()
        self.near[stream.number] = near
        self.far.peers[stream.number].on_end = partial(self.end, near)
        return stream

    def admit(self, stream: Stream, screen: Screen) -> int:
        assert self.far is not None
        near = self.near[stream.number]
        self.feeds.admit(near.number, self.far.at_robot[stream.number])
        self.far.feeds.admit(stream.number, screen)
        return near.number

    def hang_up(self, viewer: Viewer) -> None:
        assert self.far is not None
        self.far.end(viewer.stream)

    def connect(self) -> None:
        super().connect()
        for link in self._links():
            link.connect()

    def cut(self) -> None:
        super().cut()
        for link in self._links():
            link.cut()

    def send(self, most: int = 1_000_000) -> None:
        super().send(most)
        for link in self._links():
            link.send(most)

    def arrive(self, frames: int) -> None:
        super().arrive(frames)
        for link in self._links():
            link.arrive(frames)

    @property
    def is_settled(self) -> bool:
        return super().is_settled and all(link.is_settled for link in self._links())


# -- one crossing ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0, SMALL_BYTES + 1, 300_000])
def test_a_sample_crosses_once_for_all(size: int) -> None:
    link = Link()
    viewers = [link.view() for _ in range(20)]
    link.publish(1, 2, size=size)
    link.settle()
    assert all(viewer.screen.numbers == [1, 2] for viewer in viewers)
    assert link.crossed == 2


def test_each_client_finds_its_own_bytes_in_the_gap() -> None:
    link = Link(numbered)
    viewers = {own: link.view(own=own) for own in (b"ab", b"cd", b"ef")}
    link.publish(1)
    link.topic.replay(Sample(2), viewers[b"cd"].throttle)
    link.settle()
    for own, viewer in viewers.items():
        assert [frame.strip() for frame in viewer.screen.frames][:1] == [b"#" + own + b"1"]
    assert viewers[b"cd"].screen.frames[1].strip() == b"#cd2"


def test_what_one_client_gets_alone_stays_behind_what_all_got() -> None:
    link = Link()
    first = link.view()
    link.publish(1, size=100_000)
    second = link.view()
    link.topic.replay(Sample(1), second.throttle)
    link.publish(2)
    link.settle()
    assert first.screen.numbers == [1, 2]
    assert second.screen.numbers == [1, 2]


def test_the_line_is_as_fast_as_its_fastest_client() -> None:
    link = Link()
    slow = [link.view(throttle=1.0) for _ in range(10)]
    link.run(10.0, 100)
    assert 9 <= link.crossed <= 11
    assert {len(viewer.screen.frames) for viewer in slow} <= {10, 11}
    fast = link.view()
    link.crossed = 0
    link.run(10.0, 100)
    assert link.crossed == 1000 == len(fast.screen.frames)
    assert {len(viewer.screen.frames) for viewer in slow} <= {19, 20, 21}
    link.leave(fast)
    link.crossed = 0
    link.run(10.0, 100)
    assert 9 <= link.crossed <= 11


@pytest.mark.parametrize("throttles", [(0.1, 0.2, 1.0), (0.1, 0.25), (0.3, 0.5), (0.2, 0.31)])
def test_different_rates_are_served_by_one_line(throttles: tuple[float, ...]) -> None:
    link = Link()
    viewers = {throttle: link.view(throttle=throttle) for throttle in throttles}
    link.run(20.0, 200)
    for throttle, viewer in viewers.items():
        assert 20 / throttle / 1.12 <= len(viewer.screen.frames) <= 20 / throttle + 1


def test_the_newest_of_what_waits_arrives_last() -> None:
    link = Link()
    viewers = [link.view(throttle=0.5, queue=1) for _ in range(3)]
    link.publish(1, 2, 3)
    link.settle()
    link.clock.advance(0.6)
    link.settle()
    assert link.crossed == 2
    assert all(viewer.screen.numbers == [1, 3] for viewer in viewers)


def test_a_client_that_wants_pieces_is_served_by_itself() -> None:
    link = Link()
    whole, pieces = link.view(), link.view(piece=40)
    link.publish(1, size=100)
    link.settle()
    assert whole.screen.numbers == [1]
    assert len(pieces.screen.frames) > 2
    pieces.throttle.cut_to(0)
    link.topic.changed(pieces.throttle)
    link.crossed = 0
    link.publish(2)
    link.settle()
    assert link.crossed == 1
    assert int(pieces.screen.frames[-1]) == 2


def test_who_joins_while_older_samples_are_encoded_does_not_get_those() -> None:
    link = Link()
    before = link.view()
    link.late.add(iter((None, None)), ignore)  # Encoding takes another turn.
    after = link.view()
    link.late.finish_first()
    link.topic.deliver_but_to([after.throttle], Sample(1))
    link.publish(2)
    link.settle()
    assert before.screen.numbers == [1, 2]
    assert after.screen.numbers == [2]
    assert link.crossed == 2


# -- drops -----------------------------------------------------------------------------------------------


def test_the_robot_learns_what_a_client_at_the_hub_did_not_get() -> None:
    link = Link()
    slow, other = link.view(), link.view()
    slow.screen.stalls = True
    link.publish(*range(1500))
    link.settle()
    link.feeds.report()
    link.settle()
    assert slow.drops == [DropReason.BACKLOG] * 1000
    link.feeds.report()
    link.settle()
    assert slow.drops == [DropReason.BACKLOG] * 1500
    assert len(other.screen.frames) == 1500 and not other.drops


def test_what_the_uplink_cannot_carry_every_client_has_lost() -> None:
    link = Link()
    viewers = [link.view() for _ in range(3)]
    link.cut()
    link.publish(*range(10), size=100_000)
    link.connect()
    link.settle()
    for viewer in viewers:
        assert viewer.screen.numbers == [6, 7, 8, 9]
        assert viewer.drops == [DropReason.BACKLOG] * 6


def test_the_loosest_rules_of_the_clients_apply_to_the_line_and_their_own_at_the_hub() -> None:
    link = Link()
    newest, three = link.view(rules=FlowRules(depth=1)), link.view(rules=FlowRules(depth=3))
    link.publish(1)
    link.settle()
    assert (newest.screen.rules.depth, three.screen.rules.depth) == (1, 3)
    link.cut()
    link.publish(2, 3, 4, 5)
    link.connect()
    link.settle()
    assert three.screen.numbers == [1, 3, 4, 5]


# -- hostile robots and hubs -----------------------------------------------------------------------------


def sample(feed: int, data: bytes = b"1", *, is_last: bool = True, gap: int | None = None) -> bytes:
    return encode_sample(feed, Lane.SMALL, memoryview(data), binary=True, is_last=is_last, gap=gap)


@pytest.mark.parametrize(
    ("frames", "says"),
    [
        ([encode_join(1, Join(7))], "feed 7, which was not begun"),
        ([sample(1, is_last=False), sample(2)], "in the middle of a sample of feed 1"),
        ([sample(1, b"ab", gap=3)], "a gap at 3 in a sample of 2 bytes"),
        ([encode_feed(number, FeedHead("/x")) for number in range(2, MAX_FEEDS + 3)], "more than 4096 feeds"),
    ],
)
def test_a_robot_that_breaks_the_rules(frames: list[bytes], says: str) -> None:
    link = Link()
    link.view()
    link.settle()
    with pytest.raises(BadFrame, match=says):
        for frame in frames:
            link.hub.receive(frame, link.now)


def test_frames_about_strangers_have_no_effect() -> None:
    link = Link()
    viewer = link.view()
    link.settle()
    for frame in (
        encode_join(99, Join(1)),
        encode_leave(99, 1),
        encode_leave(1, 99),
        sample(99),
        encode_sample(1, Lane.SMALL, memoryview(b"1"), binary=True, is_last=True, to=99),
    ):
        link.hub.receive(frame, link.now)
    link.robot.receive(encode_drops(Drops(99, 1, DropCause.SIZE, 1)), link.now)
    link.robot.receive(encode_drops(Drops(1, 99, DropCause.SIZE, 1)), link.now)
    assert not viewer.drops and not viewer.screen.frames


def test_each_side_says_only_what_is_its_own() -> None:
    link = Link()
    with pytest.raises(BadFrame, match="only a robot has feeds"):
        link.robot.receive(encode_feed(1, FeedHead("/x")), link.now)
    with pytest.raises(BadFrame, match="only a hub reports drops"):
        link.hub.receive(encode_drops(Drops(1, 1, DropCause.SIZE, 1)), link.now)


def test_incomplete_samples_count_for_the_robot_and_are_given_up() -> None:
    link = Link(limits=Limits(message_bytes=5_000_000))
    viewer = link.view()
    link.publish(0)
    link.settle()
    part = bytes(100_000)
    for _ in range(20):
        link.hub.receive(sample(1, part, is_last=False), link.now)
    assert link.pool.sizes == {ROBOT: 2_000_000}
    link.feeds.give_up("too much of what all share")
    link.hub.receive(sample(1, part), link.now)
    assert link.pool.sizes == {}
    link.hub.receive(sample(1, b"1"), link.now)
    assert viewer.screen.numbers == [0, 1]


def test_a_sample_that_is_too_large_for_the_hub_is_lost_alone() -> None:
    link = Link()
    viewer = link.view()
    link.publish(1, size=LIMITS.message_bytes + 1)
    link.settle()
    link.publish(2)
    link.settle()
    link.feeds.report()
    link.settle()
    assert viewer.screen.numbers == [2]
    assert viewer.drops == [DropReason.SIZE]


def test_who_leaves_gets_what_was_sent_before_and_nothing_of_later() -> None:
    link = Link()
    viewer = link.view()
    link.publish(1, 2, size=50_000)
    link.leave(viewer)
    link.publish(3)
    link.topic.add(viewer.throttle)
    link.publish(4)
    link.settle()
    assert viewer.screen.numbers == [1, 2, 4]


def test_who_leaves_behind_a_sample_that_expires_is_forgotten() -> None:
    link = Link()
    viewer = link.view()
    viewer.throttle.watch(10**18, None)
    link.topic.changed(viewer.throttle)
    link.publish(1)
    link.leave(viewer)
    link.settle()
    assert viewer.screen.numbers == [] and not len(link.feeds)


def test_the_log_says_what_crosses_for_whom() -> None:
    link = Link()
    for _ in range(3):
        link.view()
    status = UplinkStatus("wss://hub/robots/rosie", hub="rwt 1", clients=3, round_trip=0.032, rate=444e3)
    status.feeds = link.robot.feeds
    assert status.feeds is not None
    status.feeds.drops[DropReason.QUEUE] = 5
    assert str(status) == (
        "wss://hub/robots/rosie (rwt 1): 3 clients and pages; round trip 32 ms; 444 kB/s;"
        " clients by topic: /topic 3; drops: queue 5"
    )


def test_nothing_is_left_of_clients_that_have_gone() -> None:
    link = Link()
    viewers = [link.view() for _ in range(3)]
    link.publish(1)
    link.settle()
    for viewer in viewers[:2]:
        link.leave(viewer)
    link.settle()
    assert len(link.feeds) == 1
    link.leave(viewers[2])
    link.settle()
    assert not len(link.feeds) and link.robot.feeds is not None and not len(link.robot.feeds)


def test_a_client_may_join_while_the_end_of_the_last_other_one_is_under_way() -> None:
    link = Link()
    first, stream = link.view(), link.open()
    link.settle()
    link.hang_up(first)
    second = link.view(stream=stream)
    link.publish(1)
    link.settle()
    assert second.screen.numbers == [1]
    link.hang_up(second)
    link.settle()
    assert not len(link.feeds)


# -- any order of events ---------------------------------------------------------------------------------


class FeedMachine(RuleBasedStateMachine):
    """Viewers that come, go and change their minds, over a line that is cut.

    A viewer of every sample gets, in order and once each, those published while it was subscribed. The
    others get some of them, in order.
    """

    make_link: type[Link] = Link

    def __init__(self) -> None:
        super().__init__()
        self.link = self.make_link(limits=Limits(message_bytes=1_000_000))
        self.published = 0
        self.viewers: dict[Viewer, list[int]] = {}
        self.every: set[Viewer] = set()
        self.is_cut = False
        self.idle: list[Stream] = []

    @precondition(lambda self: not self.is_cut)
    @rule()
    def open(self) -> None:
        self.idle.append(self.link.open())

    @precondition(lambda self: self.viewers)
    @rule(data=st.data())
    def hang_up(self, data: st.DataObject) -> None:
        viewer = data.draw(st.sampled_from(list(self.viewers)))
        self.link.hang_up(viewer)
        del self.viewers[viewer]
        self.every.discard(viewer)

    @precondition(lambda self: self.idle or not self.is_cut)
    @rule(
        throttle=st.sampled_from([0.0, 0.0, 0.1, 0.3, 1.0]), queue=st.integers(0, 3), is_latched=st.booleans()
    )
    def view(self, throttle: float, queue: int, is_latched: bool) -> None:
        viewer = self.link.view(throttle, queue, stream=self.idle.pop() if self.idle else None)
        self.viewers[viewer] = []
        if is_latched and self.published:
            self.link.topic.replay(Sample(self.published), viewer.throttle)
            self.viewers[viewer].append(self.published)
        if not throttle:
            self.every.add(viewer)

    @precondition(lambda self: self.viewers)
    @rule(data=st.data())
    def leave(self, data: st.DataObject) -> None:
        viewer = data.draw(st.sampled_from(list(self.viewers)))
        self.link.leave(viewer)
        expected = self.viewers.pop(viewer)
        self.every.discard(viewer)
        assert set(viewer.screen.numbers) <= set(expected)

    @precondition(lambda self: self.viewers)
    @rule(
        data=st.data(),
        throttle=st.sampled_from([0.0, 0.1, 0.5]),
        queue=st.integers(0, 2),
        lifespan_ns=st.sampled_from([0, 10**18, 10**19]),
    )
    def change(self, data: st.DataObject, throttle: float, queue: int, lifespan_ns: int) -> None:
        viewer = data.draw(st.sampled_from(list(self.viewers)))
        viewer.throttle.configure(throttle, queue)
        viewer.throttle.watch(lifespan_ns, None)
        self.link.topic.changed(viewer.throttle)
        self.every.discard(viewer)

    @rule(size=st.sampled_from([0, 10, 30_000, 90_000]), count=st.integers(1, 3))
    def publish(self, size: int, count: int) -> None:
        for _ in range(count):
            self.published += 1
            self.link.publish(self.published, size=size)
            for expected in self.viewers.values():
                expected.append(self.published)

    @precondition(lambda self: not self.is_cut)
    @rule(most=st.integers(1, 60_000), frames=st.integers(1, 5))
    def move(self, most: int, frames: int) -> None:
        self.link.send(most)
        self.link.arrive(frames)

    @rule()
    def cut(self) -> None:
        self.link.cut()
        self.is_cut = True

    @precondition(lambda self: self.is_cut)
    @rule()
    def reconnect(self) -> None:
        self.link.connect()
        self.is_cut = False

    @rule(seconds=st.sampled_from([0.05, 0.2, 0.7]))
    def wait(self, seconds: float) -> None:
        self.link.clock.advance(seconds)

    @precondition(lambda self: not self.is_cut)
    @rule()
    def settle(self) -> None:
        self.link.settle()
        for viewer in self.every:
            assert viewer.screen.numbers == self.viewers[viewer]

    @invariant()
    def in_order_and_once(self) -> None:
        for viewer, expected in self.viewers.items():
            numbers = viewer.screen.numbers
            assert numbers == sorted(set(numbers)) and set(numbers) <= set(expected)

    def teardown(self) -> None:
        if self.is_cut:
            self.reconnect()
        self.settle()
        for viewer in list(self.viewers):
            self.link.leave(viewer)
        self.link.settle()
        assert not len(self.link.feeds)
        if isinstance(self.link, Chain):
            assert self.link.far is not None and not len(self.link.far.feeds)


class ChainMachine(FeedMachine):
    """The same with viewers at another node than the robot's."""

    make_link = Chain


FeedMachine.TestCase.settings = settings(max_examples=120, stateful_step_count=40, deadline=None)
TestFeeds = FeedMachine.TestCase
ChainMachine.TestCase.settings = settings(max_examples=80, stateful_step_count=40, deadline=None)
TestChains = ChainMachine.TestCase


def test_a_client_that_changes_its_subscriptions_faster_than_the_uplink_sends_is_ended() -> None:
    link = Link()
    greedy, other = link.view(), link.view()
    link.settle()
    stream, changes = link.at_robot[greedy.number], 0
    for number in range(10 * MAX_CHANGES):  # Nothing of it is acknowledged.
        flow = stream.flow("/other", AS_MANY_AS_FIT, on_drop=ignore)
        member = flow.enter(("/other", number))
        if member is None:
            break
        member.wish(0.0, 0, apart=False)
        member.leave()
        changes += 2
    assert changes <= MAX_CHANGES + 2
    link.publish(1)
    link.settle()
    assert stream.is_over
    assert other.screen.numbers == [1]
    assert not link.at_robot[other.number].is_over


def test_a_hub_cannot_report_more_drops_than_there_were_samples() -> None:
    link = Link()
    viewer = link.view()
    link.settle()
    link.publish(1, 2)
    link.settle()
    for _ in range(5):
        link.hub.order(encode_drops(Drops(viewer.number, 1, DropCause.QUEUE, 1000)))
    link.settle()
    assert viewer.drops == [DropReason.QUEUE] * 2
    link.publish(3)
    link.settle()
    link.hub.order(encode_drops(Drops(viewer.number, 1, DropCause.QUEUE, 1000)))
    link.settle()
    assert viewer.drops == [DropReason.QUEUE] * 3


def test_samples_without_bytes_that_wait_at_a_hub_are_bounded() -> None:
    link = Link()
    viewer = link.view(throttle=0.001, queue=2**31)
    link.view()  # So that every sample crosses.
    link.settle()
    sample = encode_sample(1, Lane.SMALL, memoryview(b""), binary=False, is_last=True)
    for _ in range(LIMITS.data_bytes // 100):
        link.hub.receive(sample, link.now)
    link.clock.advance(10.0)
    assert 100 < len(viewer.screen.frames) <= LIMITS.data_bytes // 400 + 1


def test_the_work_of_a_sample_does_not_grow_with_the_number_of_topics() -> None:
    def calls(topics: int) -> float:
        lane = DataLane(Limits(data_frames=topics))
        for _ in range(topics):
            lane.add(TopicQueue(AS_MANY_AS_FIT, ignore, lambda: 0), [Frame(b"small")], 0)
        return count_calls(lambda: [lane.next_within(SMALL_BYTES, None) for _ in range(topics)]) / topics

    assert calls(2000) < 1.5 * calls(20)
