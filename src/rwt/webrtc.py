"""WebRTC beside the listeners of a server: its peers, out of its settings. The extra `webrtc`."""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import sniffio

from rwt_access.settings import SettingsError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from rwt.settings.webrtc import WebRtcSettings
    from rwt_transports.limits import AddressCount, Limits
    from rwt_transports.webrtc.signalling import Peers


@asynccontextmanager
async def webrtc_peers(
    settings: WebRtcSettings, limits: Limits, addresses: AddressCount
) -> AsyncIterator[Peers]:
    """Accept peers within the block.

    Args:
        settings: what the operator has set.
        limits: bounds of each connection.
        addresses: how many connections each address has.

    Raises:
        SettingsError: aiortc is not installed, the event loop is not asyncio's, or a server's URL cannot be
            used.
    """
    library = sniffio.current_async_library()
    if library != "asyncio":
        raise SettingsError(
            f"`webrtc.enabled`: aiortc runs on asyncio alone, and this event loop is {library}: leave out "
            "--trio, or webrtc"
        )
    try:
        from rwt_transports.webrtc.credentials import IceServers, IceSource  # An extra that few need.
        from rwt_transports.webrtc.ice import BadIceServer, check_ice_url
        from rwt_transports.webrtc.peer import PeerTerms
        from rwt_transports.webrtc.signalling import PeerBounds, open_peers
    except ImportError as missing:
        raise SettingsError(f"`webrtc.enabled` needs aiortc: pip install aiortc ({missing})") from missing
    try:
        urls = tuple(check_ice_url(url) for url in settings.servers)
    except BadIceServer as error:
        raise SettingsError(f"`webrtc.servers`: {error}") from error
    from rwt_transports.wires.receive_buffer import ReceiveBufferPool

    terms = PeerTerms(
        limits,
        ReceiveBufferPool(max(limits.incoming_bytes, 2 * limits.message_bytes)),
        addresses,
        settings.channels,
        settings.candidates,
        settings.connect_seconds,
    )
    credential = settings.credential.get_secret_value() if settings.credential else ""
    source = IceSource(
        urls, settings.username, credential, settings.credential_command, settings.credential_url or ""
    )
    bounds = PeerBounds(settings.peers, settings.handshakes)
    async with open_peers(terms, bounds, IceServers(source).find) as peers:
        yield peers
