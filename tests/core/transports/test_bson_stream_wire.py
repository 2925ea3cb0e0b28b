"""BSON documents on a stream: whole, byte by byte, with others behind them, and what is no document."""

from __future__ import annotations

import struct

import bson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.frames import Frame
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import PROTOCOL_ERROR, TOO_BIG
from rwt_transports.wires.bson_stream import DOCUMENTS, BsonStreamWire
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

DOCUMENT = bytes(bson.encode({"op": "publish", "topic": "/x", "msg": {"data": b"\x00\x01"}}))
EMPTY = b"\x05\x00\x00\x00\x00"


class Events:
    """Events reported by the wire; large messages only if it is asked to."""

    def __init__(self, aware: bool = True) -> None:
        self.aware = aware
        self.sizes: list[int] = []
        self.heads: list[bytes] = []
        self.end: tuple[int, str] | None = None

    def oversized_head(self, size: int, head: bytes) -> None:
        self.heads.append(head)

    def oversized(self, size: int) -> bool:
        self.sizes.append(size)
        return self.aware

    def answer(self, data: bytes) -> None:
        raise AssertionError("this protocol answers nothing by itself")

    def pong(self, data: bytes) -> None:
        raise AssertionError("this protocol has no pings")

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        assert not agreed
        self.end = (code, reason)


class Reader:
    """A wire and what came out of it."""

    def __init__(self, max_size: int = 1000, aware: bool = True) -> None:
        self.events = Events(aware)
        self.got: list[bytes] = []
        self.wire = BsonStreamWire(self.events, Limits(message_bytes=max_size), ReceiveBufferPool())
        self.wire.message = self._message

    def _message(self, data: bytes, binary: bool) -> None:
        assert binary
        self.got.append(data)


@pytest.mark.parametrize("step", [1, 2, 3, 7, 10_000])
def test_documents_cut_anywhere(step: int) -> None:
    reader = Reader()
    stream = DOCUMENT + EMPTY + DOCUMENT + DOCUMENT[:9]
    for at in range(0, len(stream), step):
        reader.wire.feed(stream[at : at + step])
    assert reader.got == [DOCUMENT, EMPTY, DOCUMENT]
    reader.wire.feed(DOCUMENT[9:])
    assert reader.got[3:] == [DOCUMENT]


@pytest.mark.parametrize("length", [0, 1, 4, -1, -(2**31)])
def test_a_length_that_no_document_has_ends_the_connection(length: int) -> None:
    reader = Reader()
    reader.wire.feed(DOCUMENT + struct.pack("<i", length) + DOCUMENT)
    assert reader.got == [DOCUMENT]
    assert reader.events.end is not None
    code, reason = reader.events.end
    assert code == PROTOCOL_ERROR
    assert str(length) in reason
    reader.wire.feed(DOCUMENT)
    assert reader.got == [DOCUMENT]


@pytest.mark.parametrize("step", [1, 64, 100_000])
def test_a_document_over_the_limit_is_skipped(step: int) -> None:
    reader = Reader(max_size=len(DOCUMENT))
    large = bytes(bson.encode({"data": b"x" * 5000}))
    stream = DOCUMENT + large + DOCUMENT
    for at in range(0, len(stream), step):
        reader.wire.feed(stream[at : at + step])
    assert reader.got == [DOCUMENT, DOCUMENT]
    assert reader.events.sizes == [len(large)]
    assert reader.events.end is None


def test_a_gigabyte_that_is_only_announced_costs_nothing() -> None:
    reader = Reader()
    reader.wire.feed(struct.pack("<i", 2**30))
    assert reader.events.sizes == [2**30]
    assert reader.got == []


def test_an_endpoint_that_cannot_be_told_loses_the_connection() -> None:
    reader = Reader(max_size=10, aware=False)
    reader.wire.feed(DOCUMENT)
    assert reader.events.end is not None
    assert reader.events.end[0] == TOO_BIG


def test_after_close_nothing_is_handed_over() -> None:
    reader = Reader()
    assert reader.wire.close(1001, "bye") == b""
    reader.wire.feed(DOCUMENT)
    assert reader.got == []


def test_a_frame_goes_out_as_it_is_and_text_does_not() -> None:
    frame = Frame(DOCUMENT[:4], DOCUMENT[4:], binary=True)
    assert DOCUMENTS.whole(frame) == DOCUMENT
    assert b"".join(DOCUMENTS.pieces(frame)) == DOCUMENT
    assert DOCUMENTS.whole(Frame(b"{}")) == b""


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_any_bytes_are_documents_or_an_end(parts: list[bytes]) -> None:
    reader = Reader(max_size=100)
    for part in parts:
        reader.wire.feed(part)
    whole = Reader(max_size=100)
    whole.wire.feed(b"".join(parts))
    assert (whole.got, whole.events.end) == (reader.got, reader.events.end)
