"""What waits to be decoded of a client's camera is bounded, and a whole picture is asked for then."""

from __future__ import annotations

import threading

import pytest
from aiortc import RTCPeerConnection

from rwt.media.webrtc.decoding import MOST_WAITING, DecoderQueue, bound_decoding

pytestmark = pytest.mark.anyio


def test_a_decoder_that_falls_behind_begins_anew_with_the_newest() -> None:
    lost = threading.Event()
    waiting = DecoderQueue(lost)
    for number in range(MOST_WAITING):
        waiting.put(number)
    assert waiting.qsize() == MOST_WAITING and not lost.is_set()
    waiting.put("newest")
    assert lost.is_set()
    assert waiting.get_nowait() == "newest" and waiting.empty()


def test_the_end_is_never_dropped() -> None:
    lost = threading.Event()
    waiting = DecoderQueue(lost)
    for number in range(MOST_WAITING):
        waiting.put(number)
    waiting.put(None)
    assert not lost.is_set()
    waiting.put("too late")
    assert [waiting.get_nowait(), waiting.get_nowait()] == [None, "too late"]


@pytest.mark.parametrize("kind", ["video", "audio"])
async def test_receivers_of_this_aiortc_are_bounded(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    connection = RTCPeerConnection()
    try:
        receiver = connection.addTransceiver(kind, "recvonly").receiver
        bound_decoding(receiver)
        assert isinstance(vars(receiver)["_RTCRtpReceiver__decoder_queue"], DecoderQueue)
        assert isinstance(vars(receiver)["_RTCRtpReceiver__decoder_error"], threading.Event)
        assert not caplog.text
    finally:
        await connection.close()
