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
from tests.core.transports.conftest import Heard

DOCUMENT = bytes(bson.encode({"op": "publish", "topic": "/x", "msg": {"data": b"\x00\x01"}}))
EMPTY = b"\x05\x00\x00\x00\x00"


def listening(max_size: int = 1000, *, skip: bool = True) -> Heard[BsonStreamWire]:
    limits = Limits(message_bytes=max_size)
    return Heard(lambda events: BsonStreamWire(events, limits, ReceiveBufferPool()), skip=skip)


@pytest.mark.parametrize("step", [1, 2, 3, 7, 10_000])
def test_documents_cut_anywhere(step: int) -> None:
    heard = listening()
    stream = DOCUMENT + EMPTY + DOCUMENT + DOCUMENT[:9]
    for at in range(0, len(stream), step):
        heard.wire.feed(stream[at : at + step])
    assert heard.messages == [(each, True) for each in (DOCUMENT, EMPTY, DOCUMENT)]
    heard.wire.feed(DOCUMENT[9:])
    assert heard.texts[3:] == [DOCUMENT]


@pytest.mark.parametrize("length", [0, 1, 4, -1, -(2**31)])
def test_a_length_that_no_document_has_ends_the_connection(length: int) -> None:
    heard = listening()
    heard.wire.feed(DOCUMENT + struct.pack("<i", length) + DOCUMENT)
    assert heard.texts == [DOCUMENT]
    ((code, reason, agreed),) = heard.ends
    assert (code, agreed) == (PROTOCOL_ERROR, False)
    assert str(length) in reason
    heard.wire.feed(DOCUMENT)
    assert heard.texts == [DOCUMENT]


@pytest.mark.parametrize("step", [1, 64, 100_000])
def test_a_document_over_the_limit_is_skipped(step: int) -> None:
    heard = listening(len(DOCUMENT))
    large = bytes(bson.encode({"data": b"x" * 5000}))
    stream = DOCUMENT + large + DOCUMENT
    for at in range(0, len(stream), step):
        heard.wire.feed(stream[at : at + step])
    assert heard.texts == [DOCUMENT, DOCUMENT]
    assert heard.sizes == [len(large)]
    assert heard.ends == []


def test_a_gigabyte_that_is_only_announced_costs_nothing() -> None:
    heard = listening()
    heard.wire.feed(struct.pack("<i", 2**30))
    assert heard.sizes == [2**30]
    assert heard.texts == []


def test_an_endpoint_that_cannot_be_told_loses_the_connection() -> None:
    heard = listening(10, skip=False)
    heard.wire.feed(DOCUMENT)
    assert heard.codes == [TOO_BIG]


def test_after_close_nothing_is_handed_over() -> None:
    heard = listening()
    assert heard.wire.close(1001, "bye") == b""
    heard.wire.feed(DOCUMENT)
    assert heard.texts == []


def test_a_frame_goes_out_as_it_is_and_text_does_not() -> None:
    frame = Frame(DOCUMENT[:4], DOCUMENT[4:], binary=True)
    assert DOCUMENTS.whole(frame) == DOCUMENT
    assert b"".join(DOCUMENTS.pieces(frame)) == DOCUMENT
    assert DOCUMENTS.whole(Frame(b"{}")) == b""


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_any_bytes_are_documents_or_an_end(parts: list[bytes]) -> None:
    heard = listening(100)
    for part in parts:
        heard.wire.feed(part)
    whole = listening(100)
    whole.wire.feed(b"".join(parts))
    assert (whole.messages, whole.ends) == (heard.messages, heard.ends)
