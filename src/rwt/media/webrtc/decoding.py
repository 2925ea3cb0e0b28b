"""A bound for what waits to be decoded: aiortc has none, and a client can send faster than it is decoded."""

from __future__ import annotations

import logging
from contextlib import suppress
from queue import Empty, Queue
from typing import TYPE_CHECKING, Any, Final

from rwt_transports.webrtc.aiortc_internals import replace_decoder_queue

if TYPE_CHECKING:
    from threading import Event

    from aiortc import RTCRtpReceiver

MOST_WAITING: Final = 32
"""Maximum number of images or audio packets queued for a decoder; a backlog of a second is useless.

Each is at most as large as aiortc's jitter buffer.
"""

logger = logging.getLogger("rwt.media.webrtc")


class DecoderQueue(Queue[Any]):
    """Queue of a decoder. When it is full, it is emptied and a key frame is requested, because frames depend
    on earlier ones.

    Args:
        lost: is set when something was dropped.
    """

    def __init__(self, lost: Event) -> None:
        super().__init__()
        self._lost = lost

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        """Add something to be decoded, or None, which ends the decoder's thread."""
        if item is not None and self.qsize() >= MOST_WAITING:
            self._drop()
        super().put(item, block, timeout)

    def _drop(self) -> None:
        self._lost.set()
        with suppress(Empty):
            while self.get_nowait() is not None:
                pass
            super().put(None)  # The decoder ends with it, and may not miss it.


def bound_decoding(receiver: RTCRtpReceiver) -> None:
    """Bound what waits in a receiver that has not begun."""
    if not replace_decoder_queue(receiver, DecoderQueue):
        logger.warning("this version of aiortc has another decoder: what waits for it is not bounded")
