"""Missing packets of a received track, with a limit for the size of a gap.

Borrows :class:`aiortc.rtcrtpreceiver.NackGenerator`, which notes each packet of a gap: 32,000 steps for one
packet. It uses no private names. :mod:`rwt_webrtc.upstream.rtp_receiver` puts it in place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from aiortc.rtcrtpreceiver import NackGenerator

from rwt_webrtc.packets.rtp import MAX_LOST

if TYPE_CHECKING:
    from aiortc.rtp import RtpPacket


class BoundedNackGenerator(NackGenerator):
    """Missing packets of a track. Of a long gap, only those are noted that can still be sent again."""

    def add(self, packet: RtpPacket) -> bool:
        """Note a packet. Returns True if others are missing before it."""
        if self.max_seq is not None and MAX_LOST < (packet.sequence_number - self.max_seq) % 65536 < 32768:
            self.max_seq = (packet.sequence_number - MAX_LOST) % 65536
        return super().add(packet)
