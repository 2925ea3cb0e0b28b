"""The two lanes: order, fairness, and what is dropped when the reader is slow. The reader here is `drain`."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.frames import Buffer, Burst, Frame, GapFrame
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, Flow, FlowRules
from rwt_transports.limits import READY_BYTES, Limits
from rwt_transports.outbox import TAKE_BYTES, Outbox
from rwt_transports.websocket.wire import SERVER_FRAMING

FILLER = b"f" * READY_BYTES
"""One frame of this size fills what waits in front of the lanes."""


def framed(*payloads: bytes) -> bytes:
    return b"".join(SERVER_FRAMING.whole(Frame(payload)) for payload in payloads)


class Box(Outbox):
    """An outbox with the flows of a bridge: what they lose, and what it asks of its surroundings."""

    def __init__(self, limits: Limits) -> None:
        self.wakes = 0
        self.overflows: list[str] = []
        super().__init__(SERVER_FRAMING, limits, self._note_wake, self.overflows.append)
        self.flows: dict[str, Flow] = {}
        self.drops: Counter[tuple[str, DropReason]] = Counter()
        self.now_ns = 0

    def _note_wake(self) -> None:
        self.wakes += 1

    def topic(self, name: str, rules: FlowRules = AS_MANY_AS_FIT) -> Flow:
        if name not in self.flows:
            self.flows[name] = self.flow(
                name,
                rules,
                on_drop=lambda reason: self.drops.update([(name, reason)]),
                time_ns=lambda: self.now_ns,
            )
        return self.flows[name]


def outbox(limits: Limits | None = None) -> Box:
    return Box(limits or Limits())


def data(box: Box, topic: str, payload: bytes) -> None:
    box.topic(topic).send(Frame(payload))


def take(box: Outbox) -> bytes:
    pieces, _ = box.take()
    return b"".join(pieces)


def drain_pieces(box: Outbox) -> list[Buffer]:
    taken, more = list[Buffer](), True
    while more:
        pieces, more = box.take()
        taken += pieces
    return taken


def drain(box: Outbox) -> bytes:
    return b"".join(drain_pieces(box))


def stalled(limits: Limits | None = None) -> Box:
    """An outbox whose ready bytes are full, so that the next frames wait in their lanes."""
    box = outbox(limits)
    box.send(Frame(FILLER))
    return box


# -- while the network keeps up ----------------------------------------------------------------------------


def test_small_frames_of_one_turn_are_one_write() -> None:
    box = outbox()
    data(box, "/a", b"1")
    box.send(Frame(b"2"))
    data(box, "/b", b"3")
    assert box.take() == ((framed(b"1", b"2", b"3"),), False)


def test_waking_once_is_enough() -> None:
    box = outbox()
    for _ in range(3):
        box.send(Frame(b"x"))
    assert box.wakes == 1
    drain(box)
    box.send(Frame(b"y"))
    assert box.wakes == 2


def test_a_frame_is_made_into_bytes_once_for_all_connections() -> None:
    frame = Frame(b'{"op":"publish"}')
    boxes = [outbox() for _ in range(5)]
    for box in boxes:
        box.topic("/a").send(frame)
    taken = [piece for box in boxes for piece in drain_pieces(box)]
    assert len(taken) == len(boxes) and all(each is taken[0] for each in taken)


def test_a_large_frame_goes_in_slices_without_a_copy() -> None:
    payload = bytes(range(256)) * 4096
    box = outbox()
    box.send(Frame(b"{", payload, b"}"))
    box.send(Frame(b"after"))
    pieces = drain_pieces(box)
    assert b"".join(pieces) == framed(b"{" + payload + b"}", b"after")
    assert max(map(len, pieces)) <= TAKE_BYTES
    shared = [piece for piece in pieces if isinstance(piece, memoryview)]
    assert sum(map(len, shared)) == len(payload) and all(piece.obj is payload for piece in shared)


def test_a_large_frame_is_gathered_in_one_go_without_a_copy() -> None:
    payload = bytes(range(256)) * 3000
    box = outbox()
    box.send(Frame(b"before"))
    box.send(Frame(b"{", payload, b"}"))
    pieces, more = box.take(2 * len(payload))
    assert b"".join(pieces) == framed(b"before", b"{" + payload + b"}")
    assert [getattr(piece, "obj", None) is payload for piece in pieces] == [False, True, False]
    assert not more and box.backlog == 0


def test_the_driver_comes_again_only_for_what_waits() -> None:
    box, ends = outbox(), []
    assert box.take() == ((), False)
    box.send(Frame(b"1"))
    assert box.take() == ((framed(b"1"),), False)
    box.send(Frame(FILLER))
    data(box, "/a", b"2")
    box.when_empty(lambda: ends.append(box.backlog))
    assert box.take()[1]
    assert box.take() == ((framed(b"2"),), True)
    assert not ends
    assert box.take() == ((), False)
    assert ends == [0]


def test_no_more_is_gathered_than_one_call_is_to_take() -> None:
    box = outbox()
    box.send(Frame(bytes(3 * TAKE_BYTES)))
    sizes, more = [], True
    while more:
        pieces, more = box.take(TAKE_BYTES // 2)
        sizes.append(sum(map(len, pieces)))
    assert max(sizes) == TAKE_BYTES // 2
    assert sum(sizes) == len(framed(bytes(3 * TAKE_BYTES)))


@given(
    st.lists(st.tuples(st.sampled_from(["/a", "/b", ""]), st.integers(1, 400_000)), max_size=12),
    st.lists(st.integers(0, 500_000), min_size=1, max_size=8),
)
def test_what_the_network_leaves_goes_first_next_time(
    frames: list[tuple[str, int]], takes: list[int]
) -> None:
    """The network takes so many bytes of each call, in turns; others are sent meanwhile."""
    box, other = outbox(), outbox()
    written, turn = b"", 0
    for topic, size in [*frames, ("/a", 1)]:
        frame = Frame(topic.encode(), b"." * size, b"!")
        for each in (box, other):
            (each.topic(topic).send if topic else each.send)(frame)
        for _ in range(3):
            pieces, _ = box.take()
            whole = b"".join(pieces)
            taken = takes[turn % len(takes)] + 1
            turn += 1
            written += whole[:taken]
            left, skipped = [], taken
            for piece in pieces:
                left.append(memoryview(piece)[min(skipped, len(piece)) :])
                skipped -= min(skipped, len(piece))
            box.put_back(left)
            assert box.taken == len(written)
            assert box.backlog >= len(whole) - taken
    written += drain(box)
    assert Counter(re.findall(rb"(/[ab])?(\.+)!", written)) == Counter(
        re.findall(rb"(/[ab])?(\.+)!", drain(other))
    )
    assert box.traffic.bytes == len(written) and box.backlog == 0


def test_middle_sized_frames_are_not_joined_with_others() -> None:
    box = outbox()
    for payload in (b"a", b"B" * 40_000, b"c", b"d"):
        box.send(Frame(payload))
    assert [len(piece) for piece in drain_pieces(box)] == [3, 40_004, 6]


# -- order and turns ---------------------------------------------------------------------------------------


def test_control_overtakes_waiting_data() -> None:
    box = stalled()
    data(box, "/a", b"data")
    box.send(Frame(b"control"))
    assert drain(box) == framed(FILLER, b"control", b"data")


@given(st.lists(st.tuples(st.sampled_from(["/a", "/b", "/c", ""]), st.integers(1, 60_000)), max_size=60))
def test_order_within_a_topic_and_within_control(frames: list[tuple[str, int]]) -> None:
    box = stalled()
    sent: dict[str, list[bytes]] = {"/a": [], "/b": [], "/c": [], "": []}
    for at, (topic, size) in enumerate(frames):
        payload = b"%s:%d:" % (topic.encode(), at) + b"." * size
        sent[topic].append(payload)
        if topic:
            data(box, topic, payload)
        else:
            box.send(Frame(payload))
    written = drain(box)
    positions = {topic: [written.index(each) for each in payloads] for topic, payloads in sent.items()}
    assert all(each == sorted(each) for each in positions.values())
    assert len(written) == len(framed(FILLER)) + sum(
        len(framed(each)) for all_ in sent.values() for each in all_
    )
    assert box.backlog == 0 and not box.drops


def test_topics_of_one_size_take_turns() -> None:
    box = stalled()
    for at in range(3):
        data(box, "/a", b"a%d" % at + b"x" * 60_000)
    for at in range(3):
        data(box, "/b", b"b%d" % at + b"x" * 60_000)
    written = drain(box)
    order = sorted((written.index(name), name) for name in (b"a0", b"a1", b"a2", b"b0", b"b1", b"b2"))
    assert [name for _, name in order] == [b"a0", b"b0", b"a1", b"b1", b"a2", b"b2"]


def test_a_small_frame_passes_every_large_one_but_the_one_being_written() -> None:
    box = outbox(Limits(data_bytes=1 << 30))
    for name in ("/map", "/cloud", "/image"):
        for at in range(3):
            data(box, name, b"%s%d" % (name.encode(), at) + bytes(1_000_000))
    written = take(box)
    while taken := take(box):
        # Whatever is being written now, what comes now is next.
        mark = b"odom at %d." % len(written)
        written += taken
        if len(taken) < TAKE_BYTES:
            continue
        data(box, "/odom", mark)
    marks = [int(text.split(b".")[0]) for text in written.split(b"odom at ")[1:]]
    assert len(marks) > 10
    for moment in marks:
        assert written.index(b"odom at %d." % moment) - moment < 1_000_000 + 2 * READY_BYTES


def test_topics_share_by_bytes_and_a_busy_time_is_forgotten_after_it() -> None:
    box = stalled()
    data(box, "/old", b"old" + bytes(1_000_000))
    drain(box)
    box.send(Frame(FILLER))
    for at in range(3):
        data(box, "/old", b"old%d" % at + bytes(50_000))
        data(box, "/new", b"new%d" % at + bytes(50_000))
    written = drain(box)
    order = sorted(written.index(b"%s%d" % (name, at)) for name in (b"old", b"new") for at in range(3))
    assert [written[at : at + 3] for at in order] == [b"old", b"new"] * 3


# -- slow readers ------------------------------------------------------------------------------------------


def test_overflow_drops_the_oldest_of_the_same_topic() -> None:
    box = stalled(Limits(data_bytes=1000))
    data(box, "/quiet", b"quiet" + b"q" * 95)
    for at in range(20):
        data(box, "/loud", b"loud%02d" % at + b"l" * 94)
    written = drain(box)
    assert b"quiet" in written
    kept = [at for at in range(20) if b"loud%02d" % at in written]
    assert kept == list(range(11, 20))
    assert box.drops == {("/loud", DropReason.BACKLOG): 11}
    assert box.traffic.dropped == {DropReason.BACKLOG: 11}


def test_a_new_topic_takes_the_place_of_the_fattest() -> None:
    box = stalled(Limits(data_bytes=1000))
    for at in range(10):
        data(box, "/loud", b"loud%02d" % at + b"l" * 94)
    data(box, "/new", b"new" + b"n" * 97)
    written = drain(box)
    assert b"new" in written and b"loud00" not in written and b"loud01" in written
    assert box.drops == {("/loud", DropReason.BACKLOG): 1}


def test_every_topic_keeps_its_newest_frame() -> None:
    box = stalled(Limits(data_bytes=100))
    for name in ("/a", "/b", "/c"):
        for at in range(3):
            data(box, name, b"%s%d" % (name.encode(), at) + b"x" * 200)
    written = drain(box)
    for topic in (b"/a", b"/b", b"/c"):
        assert [at for at in range(3) if b"%s%d" % (topic, at) in written] == [2]


@pytest.mark.parametrize("depth", [0, 1, 4])
def test_a_flow_with_a_depth_keeps_its_newest(depth: int) -> None:
    box = stalled()
    box.topic("/scan", FlowRules(depth))
    for at in range(10):
        data(box, "/scan", b"<%d>" % at)
        data(box, "/path", b"(%d)" % at)
    kept = max(depth, 1)
    assert box.drops == {("/scan", DropReason.QUEUE): 10 - kept}
    written = drain(box)
    assert all(framed(b"(%d)" % at) in written for at in range(10))
    assert [at for at in range(10) if framed(b"<%d>" % at) in written] == list(range(10 - kept, 10))


def test_a_depth_does_not_hold_back_what_the_network_takes() -> None:
    box = outbox()
    box.topic("/scan", FlowRules(1))
    for at in range(10):
        data(box, "/scan", b"%d" % at)
    assert drain(box) == framed(*(b"%d" % at for at in range(10))) and not box.drops


def test_a_smaller_depth_cuts_what_waits() -> None:
    box = stalled()
    for at in range(5):
        data(box, "/a", b"%d" % at)
    box.topic("/a").configure(FlowRules(2))
    assert drain(box) == framed(FILLER, b"3", b"4")


def test_what_keeps_all_gives_way_last() -> None:
    box = stalled(Limits(data_bytes=1000))
    box.topic("/path", FlowRules(keep_all=True))
    for at in range(9):
        data(box, "/path", b"path%d" % at + bytes(95))
    for at in range(2):
        data(box, "/scan", b"scan%d" % at + bytes(45))
    data(box, "/new", bytes(100))
    assert box.drops == {("/scan", DropReason.BACKLOG): 1}
    data(box, "/more", bytes(100))
    data(box, "/path", b"path9" + bytes(95))
    assert box.drops == {("/scan", DropReason.BACKLOG): 1, ("/path", DropReason.BACKLOG): 2}


def test_a_closed_flow_sends_what_waits_and_reports_nothing() -> None:
    box = stalled(Limits(data_frames=2))
    for at in range(2):
        data(box, "/a", b"%d" % at)
    box.flows.pop("/a").close()
    data(box, "/b", b"b")
    assert drain(box) == framed(FILLER, b"1", b"b")
    assert not box.drops and box.traffic.dropped == {DropReason.BACKLOG: 1}


def test_what_has_outlived_its_lifespan_is_not_sent() -> None:
    box = stalled()
    flow = box.topic("/tf")
    flow.send_message([Frame(b"old")], expires_ns=100)
    flow.send_message([Frame(b"new")], expires_ns=200)
    flow.send_message([Frame(b"for ever")])
    assert take(box) == framed(FILLER)
    box.now_ns = 101
    assert drain(box) == framed(b"new", b"for ever")
    assert box.drops == {("/tf", DropReason.LIFESPAN): 1}


def test_nothing_but_expired_frames_leaves_the_way_open() -> None:
    box = stalled()
    box.topic("/tf").send_message([Frame(b"old")], expires_ns=1)
    box.now_ns = 2
    assert drain(box) == framed(FILLER) and box.backlog == 0
    data(box, "/tf", b"next")
    assert take(box) == framed(b"next")


def test_a_message_in_pieces_is_sent_whole_or_not_at_all() -> None:
    box = stalled(Limits(data_frames=3))
    for at in range(6):
        box.topic("/map").send_message([Frame(b"<%d.%d>" % (at, piece)) for piece in range(3)])
    assert drain(box) == framed(FILLER, *(b"<%d.%d>" % (at, piece) for at in (3, 4, 5) for piece in range(3)))
    assert box.drops == {("/map", DropReason.BACKLOG): 3}


def test_a_message_that_has_begun_is_finished() -> None:
    box = outbox(Limits(data_frames=1))
    pieces = [Frame(b"%d" % at + bytes(100_000)) for at in range(4)]
    box.topic("/map").send_message(pieces, expires_ns=1)
    box.now_ns = 2
    data(box, "/map", b"older")
    data(box, "/map", b"newer")
    data(box, "/odom", b"odom")
    written = drain(box)
    assert written.startswith(framed(pieces[0].data, pieces[1].data))
    assert all(framed(piece.data) in written for piece in pieces)
    # Another topic waits for a piece, not for the message.
    assert written.index(b"odom") < written.index(pieces[2].data)
    assert written.index(pieces[3].data) < written.index(b"newer") and b"older" not in written


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["/a", "/b", "/c"]), st.integers(1, 3), st.integers(1, 9000), st.booleans()
        ),
        max_size=80,
    ),
    st.integers(1, 20),
)
def test_whatever_comes_memory_is_bounded_and_order_holds(
    messages: list[tuple[str, int, int, bool]], depth: int
) -> None:
    limits = Limits(data_bytes=50_000, data_frames=10)
    box = stalled(limits)
    box.topic("/a", FlowRules(depth))
    box.topic("/b", FlowRules(keep_all=True))
    written = b""
    for at, (name, pieces, size, reads) in enumerate(messages):
        frames = [
            Frame(b"<%s:%d.%d/%d>" % (name.encode(), at, n, pieces) + bytes(size)) for n in range(pieces)
        ]
        box.topic(name).send_message(frames)
        assert box.traffic.queued_messages <= limits.data_frames + 3
        assert box.backlog <= READY_BYTES + len(FILLER) + limits.data_bytes + 6 * 3 * 9100
        if reads:
            written += take(box)
    written += drain(box)
    for topic in (b"/a", b"/b", b"/c"):
        seen = [part.split(b">")[0] for part in written.split(b"<%s:" % topic)[1:]]
        numbers = [tuple(map(int, re.split(b"[./]", text))) for text in seen]
        whole = [(at, n, of) for at, n, of in numbers]
        assert whole == sorted(whole)
        assert all([n for at, n, _ in whole if at == message] == list(range(of)) for message, _, of in whole)
    assert box.traffic.messages == 1 + len(re.findall(b"<(?=/[abc]:)", written))
    assert box.traffic.bytes == len(written)
    assert not box.traffic.queued_messages and not box.backlog


def test_control_overflow_says_why_and_once() -> None:
    box = stalled(Limits(control_frames=2))
    for payload in (b"1", b"2"):
        box.send(Frame(payload))
    assert not box.overflows
    box.send(Frame(b"3"))
    (reason,) = box.overflows
    assert "control_frames" in reason and "2" in reason


def test_backlog_counts_everything_not_taken() -> None:
    box = stalled()
    data(box, "/a", b"12345")
    box.send(Frame(b"123"))
    assert box.backlog == len(framed(FILLER)) + 8
    drain(box)
    assert box.backlog == 0


# -- the end -----------------------------------------------------------------------------------------------


def test_finish_keeps_control_throws_data_away_and_lets_nothing_follow() -> None:
    box = stalled()
    data(box, "/a", b"data")
    box.send(Frame(b"control"))
    box.finish(b"<close>")
    box.send(Frame(b"late"))
    data(box, "/a", b"late")
    assert drain(box) == framed(FILLER, b"control") + b"<close>"
    box.send(Frame(b"later"))
    assert not take(box) and box.backlog == 0


def test_abandon_frees_everything() -> None:
    box = stalled()
    data(box, "/a", b"data")
    box.discard()
    assert box.backlog == 0 and not take(box)


def test_when_empty_is_called_once_and_after_the_last_byte() -> None:
    box = outbox()
    box.send(Frame(b"x"))
    calls: list[int] = []
    box.when_empty(lambda: calls.append(box.backlog))
    assert drain(box) and calls == [0]
    box.send(Frame(b"y"))
    drain(box)
    assert calls == [0]


def test_the_servers_own_notes_take_nobodys_place() -> None:
    box = stalled(Limits(data_frames=3))
    for at in range(3):
        data(box, "/a", b"%d" % at)
    box.topic("notes", FlowRules(depth=1, notes=True))
    for at in range(3):
        data(box, "notes", b"note %d" % at)
    assert box.drops == {("notes", DropReason.QUEUE): 2}
    assert framed(b"note 2") in drain(box)


@pytest.mark.parametrize("most", [10, 100_000])
@pytest.mark.parametrize("busy", [False, True])
def test_a_sample_that_is_too_large_is_left_out(most: int, busy: bool) -> None:
    box = Box(Limits(outgoing_bytes=most))
    if busy:
        box.send(Frame(FILLER))
    fits, large = Frame(b"a" * most), Frame(b"b" * (most + 1))
    for frame in (large, fits, large):
        box.topic("/x").send(frame)
    box.topic("/x").send_message((fits, large))
    assert drain(box) == framed(*([FILLER] if busy else []), fits.data)
    assert box.drops == {("/x", DropReason.SIZE): 3}


def burst_in(*boxes: Box, topic: str = "/a", frame: bytes = b"1") -> Burst:
    burst = Burst(Frame(frame))
    assert all(box.topic(topic).join(burst) for box in boxes)
    return burst


def test_a_burst_is_one_object_for_all_and_takes_frames_until_it_is_sent() -> None:
    boxes = [outbox() for _ in range(3)]
    burst = burst_in(*boxes)
    assert burst.add(Frame(b"2"))
    taken = [piece for box in boxes for piece in drain_pieces(box)]
    assert taken == [framed(b"1", b"2")] * 3
    assert taken[0] is taken[1] is taken[2]
    assert not burst.add(Frame(b"3"))
    assert [box.traffic.messages for box in boxes] == [2] * 3
    assert [take(box) for box in boxes] == [b""] * 3


def test_a_burst_keeps_its_place_among_other_frames() -> None:
    box = outbox()
    box.send(Frame(b"before"))
    burst = burst_in(box)
    box.send(Frame(b"x" * TAKE_BYTES))
    burst.add(Frame(b"2"))
    assert drain(box) == framed(b"before", b"1", b"2", b"x" * TAKE_BYTES)


def test_what_a_burst_has_grown_by_is_counted_when_it_is_sealed() -> None:
    fast, slow = outbox(), outbox()
    burst = burst_in(fast, slow)
    room = slow.room
    frame = Frame(b"y" * 1000)
    while burst.add(frame):
        pass
    assert Burst.LARGE - 1000 < burst.size <= Burst.LARGE
    assert slow.room == room
    drain(fast)
    assert slow.room == room - burst.size + 1
    assert slow.backlog == burst.size


def test_a_slow_reader_joins_no_burst_once_its_ready_bytes_are_full() -> None:
    box = stalled()
    assert not box.topic("/a").join(Burst(Frame(b"1")))
    data(box, "/a", b"1")
    assert drain(box).endswith(framed(b"1"))


def test_a_connection_that_closes_gets_nothing_more_of_a_burst() -> None:
    box = outbox()
    burst = burst_in(box)
    box.finish(b"bye")
    assert not burst.add(Frame(b"2"))
    assert drain(box) == framed(b"1") + b"bye"


def test_frames_too_large_for_a_client_are_not_added_behind_its_back() -> None:
    box = Box(Limits(outgoing_bytes=10))
    assert not box.topic("/a").join(Burst(Frame(b"1")))


# -- messages with a gap for what each receiver has of its own ----------------------------------------------


def own_of(number: int) -> bytes:
    return number.to_bytes(4, "little")


@given(
    sizes=st.lists(st.sampled_from((0, 1, 108, 109, 110, 125, 126, 3000)), min_size=1, max_size=6),
    numbers=st.lists(st.integers(0, 3), min_size=1, max_size=5),
    shares=st.booleans(),
)
def test_receivers_of_one_burst_get_their_own_bytes_in_each_gap(
    sizes: list[int], numbers: list[int], shares: bool
) -> None:
    frames = [GapFrame(b"m", 4, b"t", b"x" * size, binary=True) for size in sizes]
    framing = replace(SERVER_FRAMING, apart=SERVER_FRAMING.apart if shares else None)
    boxes = [Outbox(framing, Limits(), lambda: None, print) for _ in numbers]
    burst = Burst(frames[0])
    for box, number in zip(boxes, numbers, strict=True):
        assert box.flow("/a").join(burst.filled(own_of(number)))
    added = [frames[0], *(frame for frame in frames[1:] if burst.add(frame))]
    for box, number in zip(boxes, numbers, strict=True):
        own = own_of(number)
        expected = [Frame(b"m" + own + b"t" + frame.parts[-1], binary=True) for frame in added]
        assert box.backlog == sum(frame.size for frame in expected)
        assert drain(box) == b"".join(map(SERVER_FRAMING.whole, expected))
        assert box.traffic.messages == len(added)


def test_what_stands_between_the_gaps_is_made_once_for_all_receivers() -> None:
    asked: list[int] = []

    def apart(frames: Sequence[Frame]) -> Sequence[bytes]:
        asked.append(len(frames))
        assert SERVER_FRAMING.apart is not None
        return SERVER_FRAMING.apart(frames)

    framing = replace(SERVER_FRAMING, apart=apart)
    boxes = [Outbox(framing, Limits(), lambda: None, print) for _ in range(4)]
    burst = Burst(GapFrame(b"m", 4, b"one"))
    for number, box in enumerate((*boxes, boxes[0])):
        assert box.flow("/a").join(burst.filled(own_of(number % 2)))
    assert burst.add(GapFrame(b"m", 4, b"two"))
    taken = [drain(box) for box in boxes]
    assert asked == [2]
    assert taken[1] == taken[3] != taken[2]  # They have the same bytes of their own.
    assert not burst.filled(own_of(2)).add(Frame(b"late"))


@pytest.mark.parametrize("size", [10, 100_000])
def test_a_message_with_a_gap_shares_what_is_large(size: int) -> None:
    payload = bytes(size)
    frame = GapFrame(b"m", 4, b"stamp", payload)
    first, second = frame.filled(own_of(1)), frame.filled(own_of(2))
    assert first.data == b"m" + own_of(1) + b"stamp" + payload
    assert (first.size, second.size) == (frame.size, frame.size) == (len(first.data), len(second.data))
    assert frame.filled(own_of(1)) is first
    assert (first.parts[-1] is payload) == (size > GapFrame.SMALL)
