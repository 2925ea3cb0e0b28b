"""The two sides of an uplink, joined by a connection that is lost at any moment."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, precondition, rule

from rwt.extensions.hub.uplink.frames import (
    SMALL_BYTES,
    BadFrame,
    Data,
    Lane,
    Refusal,
    decode_frame,
    encode_accept,
    encode_ack,
    encode_data,
    encode_open,
    encode_ping,
)
from rwt.extensions.hub.uplink.streams import CREDIT_BYTES, STOP_BYTES, Stream
from rwt.extensions.hub.uplink.uplink import BULK_SHARE, MAX_ORDERS, PONG_SECONDS, RESUME_SECONDS, Uplink
from rwt_protocol.frames import Frame
from rwt_transports import Limits
from rwt_transports.api import FlowControl
from rwt_transports.endpoint import FlowRules
from rwt_transports.shared_pool import Holder
from rwt_transports.wires.receive_buffer import Incomplete, ReceiveBufferPool

LIMITS = Limits(message_bytes=1_000_000, close_seconds=1.0)


@dataclass(eq=False)
class End:
    """Endpoint of a stream, which keeps what it hears."""

    stream: Stream
    heard: list[bytes] = field(default_factory=list)
    ended: list[tuple[int, str]] = field(default_factory=list)
    flow_control: FlowControl | None = None

    def set_flow_control(self, flow_control: FlowControl) -> None:
        self.flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        assert not self.ended
        self.heard.append(data)

    def closed(self, code: int, reason: str) -> None:
        self.ended.append((code, reason))


class Pool(ReceiveBufferPool):
    """Pool that knows who receives something."""

    def __init__(self, most: int) -> None:
        super().__init__(most)
        self.receivers: set[Incomplete] = set()

    def hold(self, receiver: Incomplete, size: int, holder: Holder) -> None:
        self.receivers.add(receiver)
        super().hold(receiver, size, holder)

    def release(self, receiver: Incomplete) -> None:
        self.receivers.discard(receiver)
        super().release(receiver)


class Sides:
    """A hub and a robot; frames in flight are kept in order.

    Attributes:
        to_robot, to_hub: frames in flight.
        robots: endpoints at the robot by stream, opened so far.
    """

    def __init__(self, limits: Limits = LIMITS) -> None:
        self.now = 0.0
        self.pool = Pool(4_000_000)
        self.hub = Uplink("s", limits, self.pool, lambda: None, repeats=False)
        self.robot = Uplink("s", limits, self.pool, lambda: None, repeats=True, opened=self._opened)
        self.robots: dict[int, End] = {}
        self.to_robot: deque[bytes] = deque()
        self.to_hub: deque[bytes] = deque()
        self.connect()

    def _opened(self, stream: Stream, opening: bytes) -> None:
        end = self.robots[stream.number] = End(stream)
        stream.begin(end)

    def open(self) -> End:
        stream = self.hub.open(b"{}", "192.0.2.1")
        end = End(stream)
        stream.begin(end)
        return end

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
                self.hub.receive(self.to_hub.popleft(), self.now)

    def settle(self) -> None:
        """Let everything arrive."""
        for _ in range(10_000):
            self.now += 0.001
            self.send()
            if not (self.to_robot or self.to_hub):
                if not (self.hub.has_more or self.robot.has_more):
                    return
                continue
            self.arrive(max(len(self.to_robot), len(self.to_hub)))
        raise AssertionError("it does not settle")


def text(data: bytes) -> Frame:
    return Frame(data)


def lanes(frames: list[bytes] | deque[bytes]) -> list[Lane]:
    """Return the lanes of the messages among frames."""
    return [frame.lane for frame in map(decode_frame, frames) if isinstance(frame, Data)]


# -- messages --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0, 1, 4096, 4097, SMALL_BYTES + 1, CREDIT_BYTES, 3 * CREDIT_BYTES + 1])
def test_a_message_of_any_size_arrives_both_ways(size: int) -> None:
    sides, message = Sides(), bytes(range(256)) * (size // 256 + 1)
    end = sides.open()
    sides.settle()
    robot = sides.robots[1]
    end.stream.send(text(message[:size]))
    robot.stream.send(text(message[:size]))
    sides.settle()
    assert robot.heard == end.heard == [message[:size]]


def test_a_message_beyond_the_limit_ends_its_stream_alone() -> None:
    sides = Sides()
    large, other = sides.open(), sides.open()
    large.stream.send(text(bytes(LIMITS.message_bytes + 1)))
    other.stream.send(text(b"x"))
    sides.settle()
    assert [code for code, _ in large.ended] == [1009]
    assert sides.robots[2].heard == [b"x"]


def test_messages_of_a_stream_keep_their_order_whatever_their_size() -> None:
    sides = Sides()
    end = sides.open()
    messages = [bytes([number]) * size for number, size in enumerate([10, 50_000, 10, 70_000, 0, 10])]
    for message in messages:
        end.stream.send(text(message))
    sides.settle()
    assert sides.robots[1].heard == messages


def test_small_samples_overtake_a_large_one_but_not_one_of_their_topic() -> None:
    sides = Sides()
    end = sides.open()
    sides.settle()
    stream = sides.robots[1].stream
    image, odometry = stream.flow("/image"), stream.flow("/odom")
    image.send(text(b"i" * 100_000))
    sides.to_hub += sides.robot.take(8_000, sides.now)  # The image has begun.
    image.send(text(b"small image"))
    odometry.send(text(b"odometry"))
    sides.settle()
    assert [heard[:11] for heard in end.heard] == [b"odometry", b"i" * 11, b"small image"]


def test_a_large_sample_behind_a_small_one_is_sent() -> None:
    sides = Sides()
    end = sides.open()
    sides.settle()
    topic = sides.robots[1].stream.flow("/map")
    topic.send(text(b"small"))
    topic.send(text(bytes(SMALL_BYTES + 1)))
    sides.settle()
    assert list(map(len, end.heard)) == [5, SMALL_BYTES + 1]


def test_the_stop_overtakes_everything_even_without_room_or_credit() -> None:
    sides = Sides()
    end = sides.open()
    sides.settle()
    end.stream.send(text(bytes(2 * CREDIT_BYTES)))
    while frames := sides.hub.take(1_000_000, sides.now):
        sides.to_robot += frames
    assert not sides.hub.has_more  # The window is full.
    stop = b"stop".ljust(STOP_BYTES)
    end.stream.send_stop(text(stop))
    (frame,) = sides.hub.take(1_000_000, sides.now)
    assert lanes([frame]) == [Lane.STOP]
    sides.robot.receive(frame, sides.now)
    assert sides.robots[1].heard == [stop]


def test_replies_go_first_and_bulk_gets_its_share() -> None:
    sides = Sides()
    sides.open()
    sides.open()
    sides.settle()
    replies, file = (sides.robots[number].stream for number in (1, 2))
    file.send(text(bytes(900_000)))
    for _ in range(1000):
        replies.send(text(bytes(4096)))
    assert lanes(sides.robot.take(1, sides.now)) == [Lane.REPLIES]
    while replies.backlog:
        sides.now += 0.001
        sides.send(4096)
        sides.arrive(100)
    assert file.sent_bytes >= replies.sent_bytes / (BULK_SHARE + 1)


def test_streams_take_turns() -> None:
    sides = Sides()
    for _ in range(3):
        sides.open()
    sides.settle()
    for end in sides.robots.values():
        for _ in range(4):
            end.stream.send(text(b"x"))
    sent = [decode_frame(frame) for frame in sides.robot.take(10_000, sides.now)]
    assert [frame.stream for frame in sent if isinstance(frame, Data)] == [1, 2, 3] * 4


# -- slow readers ----------------------------------------------------------------------------------------


def test_a_paused_reader_holds_back_its_stream_alone() -> None:
    sides = Sides()
    paused, other = sides.open(), sides.open()
    sides.settle()
    paused.stream.pause()
    for stream in (sides.robots[1].stream, sides.robots[2].stream):
        for _ in range(20):
            stream.send(text(bytes(100_000)))
    sides.settle()
    assert len(other.heard) == 20
    assert sum(map(len, paused.heard)) <= CREDIT_BYTES
    assert sides.robots[1].stream.backlog >= 2_000_000 - CREDIT_BYTES
    paused.stream.resume()
    sides.settle()
    assert len(paused.heard) == 20


def test_a_slow_reader_loses_the_oldest_samples_of_a_topic() -> None:
    sides = Sides()
    paused = sides.open()
    sides.settle()
    paused.stream.pause()
    dropped: list[object] = []
    flow = sides.robots[1].stream.flow("/image", FlowRules(depth=1), on_drop=dropped.append)
    for number in range(10):
        flow.send(text(bytes([number]) * 200_000))
        sides.settle()
    paused.stream.resume()
    sides.settle()
    assert [heard[0] for heard in paused.heard] == [0, 1, 9]
    assert len(dropped) == 7


def test_more_than_the_credit_is_a_broken_rule() -> None:
    sides = Sides()
    sides.open().stream.pause()
    sides.settle()
    part = encode_data(1, Lane.BULK, memoryview(bytes(60_000)), binary=True, is_last=False)
    with pytest.raises(BadFrame, match="exceeds its credit"):
        for _ in range(6):
            sides.hub.receive(part, sides.now)


def test_incomplete_messages_share_what_all_connections_have() -> None:
    sides = Sides(Limits(message_bytes=5_000_000))
    ends = [sides.open() for _ in range(3)]
    sides.settle()
    part = encode_data(1, Lane.BULK, memoryview(bytes(100_000)), binary=True, is_last=False)
    for _ in range(14):
        for number in sides.hub.streams:
            sides.hub.receive(part[:2] + number.to_bytes(4, "big") + part[6:], sides.now)
    sides.hub.take(1_000_000, sides.now)
    assert sum(bool(end.ended) for end in ends) == 1


# -- endings ---------------------------------------------------------------------------------------------


def test_what_was_sent_before_the_end_arrives_before_it() -> None:
    sides = Sides()
    end = sides.open()
    end.stream.send(text(bytes(100_000)))
    end.stream.close(4001, "home")
    sides.settle()
    robot = sides.robots[1]
    assert [len(heard) for heard in robot.heard] == [100_000]
    assert robot.ended == end.ended == [(4001, "home")]
    assert not sides.hub.streams and not sides.robot.streams


def test_samples_that_wait_at_the_end_are_dropped() -> None:
    sides = Sides()
    end = sides.open()
    sides.settle()
    stream = sides.robots[1].stream
    stream.flow("/image").send(text(bytes(500_000)))
    stream.send(text(b"last words"))
    stream.close(1008, "enough")
    sides.settle()
    assert (end.heard, end.ended) == ([b"last words"], [(1008, "enough")])


def test_a_stream_that_cannot_be_flushed_ends_all_the_same() -> None:
    sides = Sides()
    end = sides.open()
    sides.settle()
    sides.robots[1].stream.pause()
    end.stream.send(text(bytes(2 * CREDIT_BYTES)))
    end.stream.close(1000, "")
    sides.settle()
    assert not end.ended
    for now in (10.0, 10.5, 11.1):
        sides.hub.tick(now)
    sides.settle()
    assert end.ended


def test_only_a_hub_opens_streams_and_each_once() -> None:
    sides = Sides()
    sides.open()
    sides.settle()
    with pytest.raises(BadFrame, match="only a hub"):
        sides.hub.receive(encode_open(9, b"{}"), 0.0)
    with pytest.raises(BadFrame, match="only a robot"):
        sides.robot.receive(encode_accept(1), 0.0)
    with pytest.raises(BadFrame, match="after stream 1"):
        sides.robot.receive(encode_open(1, b"{}"), 0.0)
    with pytest.raises(BadFrame, match="ACK of"):
        sides.hub.receive(encode_ack(10_000_000), 0.0)


def test_who_acknowledges_nothing_is_not_answered_without_end() -> None:
    def refuse(stream: Stream, opening: bytes) -> None:
        stream.refuse(Refusal(503, "no room"))

    robot = Uplink("s", LIMITS, LIMITS.receive_pool(), lambda: None, repeats=True, opened=refuse)
    assert robot.carried(0, 0.0)
    with pytest.raises(BadFrame, match="not acknowledged"):
        for number in range(1, MAX_ORDERS + 3):
            robot.receive(encode_open(number, b"{}"), 0.0)
    assert not robot.streams


def test_a_flood_of_pings_is_answered_once() -> None:
    sides = Sides()
    for number in range(1000):
        sides.hub.receive(encode_ping(b"%d" % number), 0.0)
    assert [frame for frame in sides.hub.take(10, 0.0) if frame[0] == 67] == [
        encode_ping(b"999", is_answer=True)
    ]


@pytest.mark.parametrize(("watched", "seconds"), [(True, 0.5), (False, 8.0)])
def test_silence_ends_a_connection(watched: bool, seconds: float) -> None:
    sides = Sides()
    if watched:
        sides.open()
    sides.settle()
    asked = sides.now + seconds
    assert sides.hub.tick(asked - 0.1) and not sides.hub.take(100, asked)
    assert sides.hub.tick(asked) and sides.hub.take(100, asked) == [encode_ping()]
    assert sides.hub.tick(asked + PONG_SECONDS - 0.1)
    assert not sides.hub.tick(asked + PONG_SECONDS + 0.1)
    sides.hub.receive(encode_ping(is_answer=True), asked + PONG_SECONDS)
    assert sides.hub.tick(asked + PONG_SECONDS)


def test_a_stream_on_a_connection_that_was_idle_is_no_silence() -> None:
    sides = Sides()
    sides.settle()
    sides.now += 10.0
    sides.open()
    assert sides.hub.tick(sides.now) and sides.robot.tick(sides.now)


# -- lost connections ------------------------------------------------------------------------------------


def test_messages_of_the_robot_survive_a_loss_and_those_of_clients_are_not_repeated() -> None:
    sides = Sides()
    quiet, talking = sides.open(), sides.open()
    sides.settle()
    for number in (1, 2):
        sides.robots[number].stream.send(text(bytes(50_000)))
    talking.stream.send(text(b"move"))
    sides.send()
    sides.arrive(3)
    sides.cut()
    sides.connect()
    sides.settle()
    assert [len(heard) for heard in quiet.heard] == [50_000]
    assert not quiet.ended
    # The message had arrived: only the robot knew.
    assert sides.robots[2].heard == [b"move"] and not talking.ended


def test_a_message_that_may_be_lost_ends_its_stream_at_both_sides() -> None:
    sides = Sides()
    end = sides.open()
    sides.settle()
    end.stream.send(text(b"move"))
    sides.send()
    sides.cut()
    sides.connect()
    sides.settle()
    ((code, reason),) = end.ended
    assert code == 1006 and "outcome is unknown" in reason
    assert sides.robots[1].heard == [] and sides.robots[1].ended


def test_a_message_that_waits_when_the_connection_is_lost_is_never_sent() -> None:
    sides = Sides()
    end = sides.open()
    sides.settle()
    end.stream.send(text(b"move"))
    sides.cut()
    assert end.ended
    sides.connect()
    sides.settle()
    assert sides.robots[1].heard == [] and sides.robots[1].ended


def test_streams_end_if_the_connection_does_not_come_back() -> None:
    sides = Sides()
    sides.open()
    sides.settle()
    sides.cut()
    assert sides.robot.tick(sides.now + RESUME_SECONDS - 0.1)
    assert not sides.robot.tick(sides.now + RESUME_SECONDS)


@pytest.mark.parametrize("received", [1, 10**9])
def test_a_session_that_cannot_be_resumed_is_refused(received: int) -> None:
    sides = Sides()
    sides.open()
    sides.settle()
    sides.cut()
    assert not sides.hub.carried(received, sides.now)


class Losses(RuleBasedStateMachine):
    """Any messages in any order, and losses at any frame."""

    streams = Bundle("streams")

    def __init__(self) -> None:
        super().__init__()
        self.sides = Sides()
        self.ends: list[End] = []
        self.down: dict[int, list[bytes]] = {}
        self.up: dict[int, list[bytes]] = {}
        self.counter = 0
        self.is_cut = False

    @rule(target=streams)
    @precondition(lambda self: not self.is_cut)
    def open(self) -> End:
        end = self.sides.open()
        self.ends.append(end)
        self.down[end.stream.number], self.up[end.stream.number] = [], []
        return end

    def _message(self, size: int) -> bytes:
        self.counter += 1
        return b"%08d" % self.counter + bytes(size)

    # A hub ends the client of a message that it cannot send, so none is sent during an outage.
    @rule(end=streams, size=st.sampled_from([0, 100, 5_000, 40_000, 300_000]))
    @precondition(lambda self: not self.is_cut)
    def client_sends(self, end: End, size: int) -> None:
        if not end.ended:
            message = self._message(size)
            self.down[end.stream.number].append(message)
            end.stream.send(text(message))

    @rule(end=streams, size=st.sampled_from([0, 100, 5_000, 40_000, 300_000]))
    def robot_sends(self, end: End, size: int) -> None:
        robot = self.sides.robots.get(end.stream.number)
        if robot is not None and not robot.ended:
            message = self._message(size)
            self.up[end.stream.number].append(message)
            robot.stream.send(text(message))

    @rule(end=streams, code=st.sampled_from([1000, 4000]))
    def client_leaves(self, end: End, code: int) -> None:
        end.stream.close(code, "")

    @rule(end=streams)
    def robot_ends_a_stream(self, end: End) -> None:
        robot = self.sides.robots.get(end.stream.number)
        if robot is not None:
            robot.stream.close(4001, "enough")

    @rule(most=st.sampled_from([1, 5_000, 100_000]))
    def send(self, most: int) -> None:
        self.sides.now += 0.001
        self.sides.send(most)

    @rule(frames=st.integers(1, 20))
    def arrive(self, frames: int) -> None:
        self.sides.now += 0.01
        self.sides.arrive(frames)

    @rule(frames=st.integers(0, 10))
    @precondition(lambda self: not self.is_cut)
    def lose(self, frames: int) -> None:
        self.sides.arrive(frames)
        self.sides.cut()
        self.is_cut = True

    @rule()
    @precondition(lambda self: self.is_cut)
    def resume(self) -> None:
        self.sides.connect()
        self.is_cut = False

    @invariant()
    def messages_arrive_in_order_and_at_most_once(self) -> None:
        for end in self.ends:
            number = end.stream.number
            robot = self.sides.robots.get(number)
            if robot is not None:
                assert robot.heard == self.down[number][: len(robot.heard)]
            assert end.heard == self.up[number][: len(end.heard)]
            assert len(end.ended) <= 1

    def teardown(self) -> None:
        if self.is_cut:
            self.sides.connect()
        self.sides.settle()
        for end in self.ends:
            robot = self.sides.robots.get(end.stream.number)
            if not end.ended:
                # Nothing is lost on a stream that is still open.
                assert robot is not None and not robot.ended
                assert robot.heard == self.down[end.stream.number]
                assert end.heard == self.up[end.stream.number]
                end.stream.close(1000, "")
        self.sides.settle()
        assert all(len(end.ended) == 1 for end in [*self.ends, *self.sides.robots.values()])
        assert not self.sides.hub.streams and not self.sides.robot.streams
        assert not self.sides.pool.receivers


TestLosses = Losses.TestCase
TestLosses.settings = settings(max_examples=200, stateful_step_count=50, deadline=None)
