"""Receiver of a track, with a limit for what waits to be decoded.

Borrows :class:`aiortc.RTCRtpReceiver`, which queues all that a peer sends. Private names, and why each is
needed:

* ``__decoder_queue``: replace the queue before the decoder's thread begins.
* ``__decoder_error``: the event that makes aiortc request a key frame.
* ``__nack_generator``: replace what notes missing packets.
"""

from __future__ import annotations

from collections.abc import Callable
from queue import Queue
from threading import Event
from typing import Any, cast

from aiortc import RTCRtpReceiver

from rwt_webrtc.upstream.nack_generator import BoundedNackGenerator


def replace_decoder_queue(receiver: RTCRtpReceiver, make_queue: Callable[[Event], Queue[Any]]) -> None:
    """Replace the queue of a receiver that has not begun.

    Args:
        make_queue: makes the queue, called with the event that asks for a key frame.
    """
    private = cast("Any", receiver)
    private._RTCRtpReceiver__decoder_queue = make_queue(private._RTCRtpReceiver__decoder_error)
    if private._RTCRtpReceiver__nack_generator is not None:
        private._RTCRtpReceiver__nack_generator = BoundedNackGenerator()
