"""DTLS transport of a peer, which validates RTP and RTCP packets before aiortc parses them.

Borrows :class:`aiortc.RTCDtlsTransport`, which ends its receiving task for packets with wrong lengths, and
takes transport-wide feedback for lost packets. Private names, and why each is needed:

* ``_handle_rtp_data``: discard an invalid packet.
* ``_handle_rtcp_data``: discard an invalid packet, and take the feedback out of it.
* ``_ssl``: break the reference cycle of pyOpenSSL's context, and release the connection.
* ``Context._verify_helper``: holds a function that holds the helper: that cycle.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable

from aiortc import RTCCertificate, RTCDtlsTransport, RTCIceTransport

from rwt_transports.background import ignore
from rwt_webrtc.congestion.feedback import Feedback, read_feedback
from rwt_webrtc.packets.rtp import BadMedia, check_rtp, split_rtcp

logger = logging.getLogger("rwt_webrtc.transport")


class GuardedDtlsTransport(RTCDtlsTransport):
    """DTLS transport of a peer.

    Args:
        on_feedback: called with transport-wide feedback.
    """

    def __init__(
        self,
        ice: RTCIceTransport,
        certificates: list[RTCCertificate],
        on_feedback: Callable[[Feedback], None],
    ) -> None:
        super().__init__(ice, certificates)
        self._on_feedback = on_feedback

    async def _handle_rtp_data(self, data: bytes, arrival_time_ms: int) -> None:
        try:
            check_rtp(data)
            await super()._handle_rtp_data(data, arrival_time_ms)
        except (BadMedia, struct.error) as bad:  # Header extensions of wrong sizes.
            logger.debug("discarded %s", bad)

    async def _handle_rtcp_data(self, data: bytes) -> None:
        try:
            rest, parts = split_rtcp(data)
            for part in parts:
                self._on_feedback(read_feedback(part))
            if rest:
                await super()._handle_rtcp_data(rest)
        except BadMedia as bad:
            logger.debug("discarded %s", bad)

    def release(self) -> None:
        """Break the reference cycles of a transport that has been closed for a while."""
        self.remove_all_listeners()
        self._on_feedback = ignore
        if self._ssl is not None:
            vars(self._ssl.get_context()._verify_helper).clear()
            self._ssl = None
