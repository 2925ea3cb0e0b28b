"""Rows of the table of shared pools: what all peers of a server share."""

from __future__ import annotations

from typing import Final

from rwt_transports.shared_pool import PoolRow

PEERS: Final = PoolRow("WebRTC peers", "webrtc.peers", "peer connections")
HANDSHAKES: Final = PoolRow("WebRTC handshakes", "webrtc.handshakes", "connecting peers")
OFFERS: Final = PoolRow("waiting WebRTC offers", "webrtc.handshakes", "bytes of waiting offers")
