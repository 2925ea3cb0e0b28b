"""Limit on undecoded frames of a client's camera, and the request for a key frame."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest
from aiortc import RTCPeerConnection

from rwt_webrtc.media.decoding import (
    FRAME_BYTES,
    MOST_WAITING,
    BadFrame,
    DecoderQueue,
    bound_decoding,
    check_frame,
)
from tests.webrtc.encoded_frames import vp8_header

pytestmark = pytest.mark.anyio


def _item(name: object) -> tuple[object, object]:
    """Item of aiortc's queue: a codec and a frame."""
    return SimpleNamespace(mimeType="audio/opus", name=name), SimpleNamespace(data=b"")


def _queue(lost: threading.Event) -> DecoderQueue:
    return DecoderQueue(lost, lambda reason: pytest.fail(reason))


def test_a_decoder_that_falls_behind_begins_anew_with_the_newest() -> None:
    lost = threading.Event()
    waiting = _queue(lost)
    for number in range(MOST_WAITING):
        waiting.put(_item(number))
    assert waiting.qsize() == MOST_WAITING and not lost.is_set()
    newest = _item("newest")
    waiting.put(newest)
    assert lost.is_set()
    assert waiting.get_nowait() == newest and waiting.empty()


def test_the_end_is_never_dropped() -> None:
    lost = threading.Event()
    waiting = _queue(lost)
    for number in range(MOST_WAITING):
        waiting.put(_item(number))
    waiting.put(None)
    assert not lost.is_set()
    late = _item("too late")
    waiting.put(late)
    assert [waiting.get_nowait(), waiting.get_nowait()] == [None, late]


@pytest.mark.parametrize("kind", ["video", "audio"])
async def test_receivers_of_this_aiortc_are_bounded(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    connection = RTCPeerConnection()
    try:
        receiver = connection.addTransceiver(kind, "recvonly").receiver
        bound_decoding(receiver, lambda reason: None)
        assert isinstance(vars(receiver)["_RTCRtpReceiver__decoder_queue"], DecoderQueue)
        assert isinstance(vars(receiver)["_RTCRtpReceiver__decoder_error"], threading.Event)
        assert not caplog.text
    finally:
        await connection.close()


def test_after_an_invalid_image_nothing_is_decoded() -> None:
    reasons: list[str] = []
    waiting = DecoderQueue(threading.Event(), reasons.append)
    codec = SimpleNamespace(mimeType="video/VP8")
    waiting.put((codec, SimpleNamespace(data=vp8_header(16383, 16383))))
    waiting.put((codec, SimpleNamespace(data=vp8_header(64, 48))))
    assert waiting.empty()
    assert reasons == ["images of 268402689 pixels; the limit is 4096000"]
    waiting.put(None)
    assert waiting.get_nowait() is None


def test_a_frame_of_many_bytes() -> None:
    check_frame("audio/opus", bytes(FRAME_BYTES))
    with pytest.raises(BadFrame, match=f"the limit is {FRAME_BYTES}"):
        check_frame("video/VP8", bytes(FRAME_BYTES + 1))
