"""WebRTC peers of a server, from its settings. Needs the extra `webrtc`."""

from __future__ import annotations

from contextlib import AsyncExitStack, asynccontextmanager
from typing import TYPE_CHECKING

from rwt.access.settings import SettingsError
from rwt_transports.background import runs_asyncio

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from rwt.access.access import Access
    from rwt.access.graph_view import GraphView
    from rwt.extensions.video import WebVideoServer
    from rwt.settings.models import WebRtcSettings
    from rwt_graph.api import Graph
    from rwt_transports.http.addresses import AddressCount
    from rwt_transports.http.routes import Route
    from rwt_transports.limits import Limits
    from rwt_transports.wires.receive_buffer import ReceiveBufferPool
    from rwt_webrtc.media import AudioTopics, IncomingMedia
    from rwt_webrtc.transport.signalling import Peers


@asynccontextmanager
async def webrtc_peers(
    settings: WebRtcSettings, limits: Limits, addresses: AddressCount, buffers: ReceiveBufferPool
) -> AsyncIterator[Peers]:
    """Accept peers within the block.

    Raises:
        SettingsError: aiortc is not installed, the event loop is not asyncio's, or a server's URL is invalid.
    """
    if not runs_asyncio():
        raise SettingsError(
            "`webrtc.enabled`: aiortc runs on asyncio alone, and this event loop is another, such as trio's:"
            " start the server on asyncio, or leave webrtc out"
        )
    try:
        from rwt_webrtc.transport.credentials import IceServers, IceSource  # An extra that few need.
        from rwt_webrtc.transport.ice_servers import BadIceServer, check_ice_url
        from rwt_webrtc.transport.peer import PeerTerms
        from rwt_webrtc.transport.signalling import PeerBounds, open_peers
    except ImportError as missing:
        raise SettingsError(
            f"`webrtc.enabled` needs aiortc: pip install 'robot-web-tools[webrtc]' ({missing})"
        ) from missing
    try:
        urls = tuple(check_ice_url(url) for url in settings.servers)
    except BadIceServer as error:
        raise SettingsError(f"`webrtc.servers`: {error}") from error

    terms = PeerTerms(
        limits,
        buffers,
        addresses,
        settings.channels,
        settings.candidates,
        settings.connect_seconds,
        tell_private=settings.addresses != "auto",
        relay_only=settings.addresses == "relay",
    )
    credential = settings.credential.get_secret_value() if settings.credential else ""
    source = IceSource(
        urls, settings.username, credential, settings.credential_command, settings.credential_url or ""
    )
    bounds = PeerBounds(settings.peers, settings.handshakes)
    async with open_peers(terms, bounds, IceServers(source).find) as peers:
        yield peers


def webrtc_media(
    graph: Graph, access: Access, linger: float, stack: AsyncExitStack
) -> tuple[IncomingMedia, AudioTopics] | None:
    """Return the publisher of clients' media and the audio topics, until `stack` is closed.

    Returns None if aiortc is not installed; :func:`webrtc_peers` reports that."""
    try:
        from rwt_webrtc.media import AudioTopics, IncomingMedia  # An extra that few need.
    except ImportError:
        return None
    incoming = IncomingMedia(graph, access, linger)
    stack.callback(incoming.close)
    sound = AudioTopics(graph)
    stack.callback(sound.close)
    return incoming, sound


def media_routes(
    peers: Peers, video: WebVideoServer | None, media: tuple[IncomingMedia, AudioTopics] | None
) -> tuple[Route[GraphView], ...]:
    """Return the routes of media to and from peers."""
    if media is None:
        return ()
    from rwt_webrtc.media import watch_routes

    incoming, sound = media
    return (*watch_routes(peers, video, sound), *incoming.routes(peers))
