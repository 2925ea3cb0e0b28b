"""An audio topic as an audio track for one listener, out of the encoder that all listeners share."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final

from aiortc import MediaStreamTrack
from aiortc.mediastreams import MediaStreamError
from av import Packet

from rwt.media.webrtc.opus_encoder import RATE

if TYPE_CHECKING:
    from rwt.media.webrtc.audio_topics import Listener

_SAMPLE: Final = Fraction(1, RATE)


class AudioTrack(MediaStreamTrack):
    """What one listener hears of a topic.

    Args:
        listener: whose packets they are.
        on_end: called once when there will be no more audio, with the reason.
    """

    kind = "audio"

    def __init__(self, listener: Listener, on_end: Callable[[str], None]) -> None:
        super().__init__()
        self._listener = listener
        self._on_end = on_end

    async def recv(self) -> Packet[Any]:
        """The next 20 ms, encoded; raises MediaStreamError when there will be none."""
        if self.readyState != "live":
            raise MediaStreamError
        encoded = await self._listener.next()
        if encoded is None:
            self.stop()
            self._on_end(str(self._listener.failure or "the topic's sound has ended"))
            raise MediaStreamError
        packet = Packet(encoded.data)
        packet.pts = encoded.at
        packet.time_base = _SAMPLE
        return packet

    def stop(self) -> None:
        """Listen no more."""
        super().stop()
        self._listener.leave()
