"""Messages out of fragments: in any order, with gaps that their sender gives up, within bounds."""

from __future__ import annotations

from random import Random

from aiortc.rtcsctptransport import InboundStream
from hypothesis import given
from hypothesis import strategies as st

from rwt_transports.api import HEAD_BYTES
from rwt_webrtc.packets.reassembly import FIRST, LAST, UNORDERED, Reassembly, Truncated, is_later
from tests.webrtc.chunks import Chunk

TSNS = 2**32


class Held:
    """Bytes that a stream reports as held."""

    def __init__(self) -> None:
        self.bytes = self.count = 0

    def __call__(self, change: int, count: int) -> None:
        self.bytes += change
        self.count += count
        assert self.bytes >= 0 and (self.bytes > 0) == (self.count > 0)


def _chunks(messages: list[tuple[list[bytes], bool]], tsn: int, sequence: int) -> list[Chunk]:
    chunks = []
    for pieces, unordered in messages:
        for at, piece in enumerate(pieces):
            flags = FIRST * (at == 0) | LAST * (at == len(pieces) - 1) | UNORDERED * unordered
            chunks.append(Chunk(tsn % TSNS, flags, 0 if unordered else sequence % 2**16, piece))
            tsn += 1
        sequence += not unordered
    return chunks


MESSAGES = st.lists(
    st.tuples(st.lists(st.binary(min_size=1, max_size=4), min_size=1, max_size=5), st.booleans()), max_size=8
)
STARTS = st.sampled_from([0, 1, TSNS - 3, TSNS // 2 - 2])
SEQUENCES = st.sampled_from([0, 2**16 - 2, 2**15 - 1])


@given(MESSAGES, STARTS, SEQUENCES, st.randoms(use_true_random=False))
def test_every_message_comes_once_and_the_ordered_ones_in_order(
    messages: list[tuple[list[bytes], bool]], tsn: int, sequence: int, random: Random
) -> None:
    chunks = _chunks(messages, tsn, sequence)
    random.shuffle(chunks)
    held = Held()
    stream = Reassembly(7, 1000, held)
    stream.sequence_number = sequence
    got = []
    for chunk in chunks:
        stream.add_chunk(chunk)
        got += list(stream.pop_messages())
    wanted = [(b"".join(pieces), unordered) for pieces, unordered in messages]
    assert sorted(data for _, _, data in got) == sorted(data for data, _ in wanted)
    ordered = [data for data, unordered in wanted if not unordered]
    # An unordered message may come between, and be equal to an ordered one.
    remaining = iter([data for _, _, data in got])
    assert all(any(data == one for one in remaining) for data in ordered)
    assert {(stream_id, protocol) for stream_id, protocol, _ in got} <= {(7, 51)}
    assert held.bytes == 0


@given(MESSAGES, STARTS, st.randoms(use_true_random=False))
def test_it_gives_what_aiortc_s_own_gives(
    messages: list[tuple[list[bytes], bool]], tsn: int, random: Random
) -> None:
    chunks = _chunks([(pieces, False) for pieces, _ in messages], tsn, 0)
    random.shuffle(chunks)
    ours, theirs = Reassembly(7, 1000, Held()), InboundStream()
    for chunk in chunks:
        ours.add_chunk(chunk)
        theirs.add_chunk(chunk)
        assert list(ours.pop_messages()) == list(theirs.pop_messages())


def test_what_its_sender_gave_up_is_dropped_and_what_lacks_nothing_stays() -> None:
    held = Held()
    stream = Reassembly(7, 1000, held)
    first, gap, last = _chunks([([b"a", b"b", b"c"], False)], 10, 0)
    begun, ending = _chunks([([b"d", b"e"], False)], 13, 1)
    for chunk in (first, last, begun):
        stream.add_chunk(chunk)
    assert gap.tsn == 11
    stream.sequence_number = 1
    assert stream.prune_chunks(13) == 0
    stream.add_chunk(ending)
    assert list(stream.pop_messages()) == [(7, 51, b"de")]
    assert held.bytes == 0


def test_an_ordered_message_that_was_given_up_does_not_come_late() -> None:
    held = Held()
    stream = Reassembly(7, 1000, held)
    early, late = _chunks([([b"a"], False), ([b"b"], False)], 10, 0)
    stream.add_chunk(late)
    stream.sequence_number = 1
    assert [data for _, _, data in stream.pop_messages()] == [b"b"]
    stream.add_chunk(early)
    assert list(stream.pop_messages()) == []
    assert held.bytes == 0


def test_of_a_message_over_the_limit_the_beginning_stays() -> None:
    held = Held()
    stream = Reassembly(7, 5000, held)
    most = 0
    for chunk in _chunks([([b"%04d" % at * 250 for at in range(50)], False)], 10, 0):
        stream.add_chunk(chunk)
        most = max(most, held.bytes)
    ((_, _, head),) = stream.pop_messages()
    assert isinstance(head, Truncated)
    assert (len(head), head.size) == (HEAD_BYTES, 50_000)
    assert head.startswith(b"00000000")
    assert most < 10_000
    assert held.bytes == 0


def test_clearing_gives_back_all_that_is_held() -> None:
    held = Held()
    stream = Reassembly(7, 1000, held)
    for chunk in _chunks([([b"a", b"b"], False), ([b"c"], False), ([b"d"], True)], 10, 0)[1:]:
        stream.add_chunk(chunk)
    assert held.bytes > 0
    stream.clear()
    assert held.bytes == 0


def test_numbers_are_counted_round() -> None:
    assert is_later(0, TSNS - 1)
    assert not is_later(TSNS - 1, 0)
    assert not is_later(5, 5)
    assert is_later(1, 65_535, 2**16)
