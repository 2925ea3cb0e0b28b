"""WebRTC peers of a server, and the media to and from them."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import TYPE_CHECKING, cast

from rwt.access.decisions import declare
from rwt.access.settings import SettingsError
from rwt_transports.background import runs_asyncio
from rwt_webrtc.media import AudioTopics, IncomingMedia, watch_routes
from rwt_webrtc.transport.credentials import IceServers, IceSource
from rwt_webrtc.transport.ice_servers import BadIceServer, check_ice_url
from rwt_webrtc.transport.peer import PeerTerms
from rwt_webrtc.transport.signalling import PeerBounds, data_routes, open_peers

if TYPE_CHECKING:
    from rwt.access.graph_view import GraphView
    from rwt.declarations import ServiceContext
    from rwt.extensions.video import WebVideoServer
    from rwt_transports.endpoint import Accept
    from rwt_transports.http.routes import Route
    from rwt_webrtc.settings import WebRtcSettings

VIDEO_SERVER = "web_video_server"

declare("whip", "publisher")


@asynccontextmanager
async def serve_webrtc(context: ServiceContext, settings: WebRtcSettings) -> AsyncIterator[None]:
    """Accept peers within the block.

    Raises:
        SettingsError: the event loop is not asyncio's, or a server's URL is invalid.
    """
    if not runs_asyncio():
        raise SettingsError(
            "`webrtc.enabled`: aiortc runs on asyncio alone, and this event loop is another, such as trio's:"
            " start the server on asyncio, or leave webrtc out"
        )
    try:
        urls = tuple(check_ice_url(url) for url in settings.servers)
    except BadIceServer as error:
        raise SettingsError(f"`webrtc.servers`: {error}") from error
    terms = PeerTerms(
        context.limits,
        context.buffers,
        context.addresses,
        settings.channels,
        settings.candidates,
        settings.connect_seconds,
        announce_private=settings.addresses != "auto",
        relay_only=settings.addresses == "relay",
    )
    credential = settings.credential.get_secret_value() if settings.credential else ""
    source = IceSource(
        urls, settings.username, credential, settings.credential_command, settings.credential_url or ""
    )
    bounds = PeerBounds(settings.peers, settings.handshakes)
    async with AsyncExitStack() as stack:
        # The peers have ended when what they publish on leaves the graph.
        incoming = IncomingMedia(context.graph, context.access, context.linger)
        stack.callback(incoming.close)
        sound = AudioTopics(context.graph)
        stack.callback(sound.close)
        peers = await stack.enter_async_context(open_peers(terms, bounds, IceServers(source).find))
        video = cast("WebVideoServer | None", context.nodes.get(VIDEO_SERVER))
        media: list[Route[GraphView]] = [*watch_routes(peers, video, sound), *incoming.routes(peers)]

        def make_routes(accept: Accept) -> Iterable[Route[GraphView]]:
            yield from data_routes(peers, accept)
            yield from media

        context.add_routes(make_routes)
        context.add_metrics(peers.metrics)
        context.on_reload(incoming.reload_roles)
        yield
