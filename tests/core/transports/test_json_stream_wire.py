"""JSON objects on a stream, cut anywhere (TCP-01 to TCP-03)."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.frames import Frame
from rwt_transports.limits import Limits
from rwt_transports.wires.json_stream import LINES, PLAIN, JsonStreamWire
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from tests.core.transports.conftest import Heard

LIMIT = 2000
Feed = Callable[[JsonStreamWire, bytes], None]


def listening(*, skip: bool = False, limit: int = LIMIT) -> Heard[JsonStreamWire]:
    limits = Limits(message_bytes=limit)
    return Heard(lambda events: JsonStreamWire(events, limits, ReceiveBufferPool()), skip=skip)


def whole(wire: JsonStreamWire, data: bytes) -> None:
    wire.feed(data)


def byte_by_byte(wire: JsonStreamWire, data: bytes) -> None:
    for at in range(len(data)):
        wire.feed(data[at : at + 1])


@pytest.mark.parametrize("feed", [whole, byte_by_byte])
@pytest.mark.parametrize(
    ("data", "messages"),
    [
        (b'{"op":"x"}', [b'{"op":"x"}']),
        (b'{"a":1}{"b":2} \r\n\t{"c":{}}', [b'{"a":1}', b'{"b":2}', b'{"c":{}}']),
        (b'{"a":"}{"}', [b'{"a":"}{"}']),
        (b'{"a":"\\"}"}{"b":"\\\\"}', [b'{"a":"\\"}"}', b'{"b":"\\\\"}']),
        ('{"grün":"{ü "}'.encode(), ['{"grün":"{ü "}'.encode()]),
        (b'{"a":[{"b":[]},{}]}', [b'{"a":[{"b":[]},{}]}']),
        (b'junk\n{"a":1}', [b"junk\n", b'{"a":1}']),
        (b"\n\n  \n", []),
        (b'{"half', []),
        (b'{"a":"x\\', []),
    ],
)
def test_objects_are_found(feed: Feed, data: bytes, messages: list[bytes]) -> None:
    heard = listening()
    feed(heard.wire, data)
    assert heard.texts == messages and not heard.ends


def test_what_is_not_an_object_is_handed_over_to_be_refused() -> None:
    heard = listening()
    heard.wire.feed(b'42 {"a":1}true\n[1,2]\n{"b":2}')
    assert heard.texts == [b"42 ", b'{"a":1}', b"true\n", b"[1,2]\n", b'{"b":2}']


def test_endless_junk_does_not_pile_up() -> None:
    heard = listening()
    for _ in range(100):
        heard.wire.feed(b"x" * 1000)
    assert 90_000 < sum(map(len, heard.texts)) <= 100_000
    assert max(map(len, heard.texts)) <= 1024


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(
    st.lists(st.dictionaries(st.text(max_size=5), values, max_size=3), max_size=4),
    st.lists(st.integers(1, 30)),
)
def test_cuts_do_not_matter(objects: list[dict[str, object]], cuts: list[int]) -> None:
    data = b"".join(json.dumps(each, ensure_ascii=False).encode() for each in objects)
    heard = listening(limit=1 << 20)
    for cut in cuts:
        heard.wire.feed(data[:cut])
        data = data[cut:]
    heard.wire.feed(data)
    assert [json.loads(each) for each in heard.texts] == objects


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_any_bytes_are_taken(chunks: list[bytes]) -> None:
    heard = listening(skip=True)
    for chunk in chunks:
        heard.wire.feed(chunk)
    assert len(b"".join(heard.texts)) <= sum(map(len, chunks))


@pytest.mark.parametrize("feed", [whole, byte_by_byte])
def test_too_large_an_object_is_skipped(feed: Feed) -> None:
    heard = listening(skip=True)
    feed(heard.wire, b'{"a":"' + b"x{" * LIMIT + b'\\"}","b":{}}' + b'{"after":1}')
    assert heard.texts == [b'{"after":1}']
    assert len(heard.sizes) == 1 and heard.sizes[0] > LIMIT


@pytest.mark.parametrize("feed", [whole, byte_by_byte])
def test_too_large_an_object_ends_the_connection_when_nobody_wants_to_know(
    feed: Feed,
) -> None:
    heard = listening()
    feed(heard.wire, b'{"a":"' + b"x" * LIMIT + b'"}{"after":1}')
    assert heard.texts == []
    ((code, reason, _),) = heard.ends
    assert code == 1009 and "max_message_size" in reason


def test_an_endpoint_that_closes_hears_nothing_more() -> None:
    heard = listening()

    def once(data: bytes, binary: bool) -> None:
        heard.messages.append((data, binary))
        heard.wire.close(1000, "")

    heard.wire.message = once
    heard.wire.feed(b'{"a":1}{"b":2}')
    heard.wire.feed(b'{"c":3}')
    assert heard.texts == [b'{"a":1}']


def test_outgoing_objects() -> None:
    frame = Frame(b'{"a":', memoryview(b"1"), b"}")
    assert PLAIN.whole(frame) == b"".join(PLAIN.pieces(frame)) == b'{"a":1}'
    assert LINES.whole(frame) == b"".join(LINES.pieces(frame)) == b'{"a":1}\n'


def test_binary_has_no_place_here(caplog: pytest.LogCaptureFixture) -> None:
    assert PLAIN.whole(Frame(b"\xa1", binary=True)) == b""
    assert "binary" in caplog.text
