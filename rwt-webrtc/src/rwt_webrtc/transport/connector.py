"""Client side: an HTTP offer to a server's ``/webrtc``, and a data channel (asyncio only)."""

from __future__ import annotations

import http.client
from functools import partial
from typing import Final, Never

import anyio
import anyio.to_thread
from anyio.abc import TaskGroup

from rwt_transports.api import Attach, RemoteAddress
from rwt_transports.background import runs_asyncio
from rwt_transports.endpoint import PeerInfo, Sink
from rwt_transports.errors import ConnectError, Refused
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.routes import is_local
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_webrtc.packets.ice_guard import Reach
from rwt_webrtc.transport.ice_servers import BadIceServer, IceServer, read_configuration, read_ice_servers
from rwt_webrtc.transport.peer import Peer, PeerTerms
from rwt_webrtc.transport.sdp import CANDIDATES, OFFER_BYTES, BadDescription, read_description

LABEL: Final = "rosbridge"
PATH: Final = "webrtc"
REQUEST_SECONDS: Final = 20.0
LONGEST_SECONDS: Final = 60.0
PATH_PART: Final = 0.7
"""Part of the timeout of connecting within which a path must be found."""


class DataChannelConnector:
    """Opens an ordered, reliable data channel to a server."""

    path = ""

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Negotiate over HTTP, find a path, and attach the channel once it is open.

        Raises:
            OSError: the server cannot be reached by HTTP.
            ConnectError: the server refuses the offer, or no path to it was found; or the event loop is not
                asyncio's.
        """
        require_asyncio()
        limits = address.limits
        ended, opened = anyio.Event(), anyio.Event()
        servers = await find_servers(address)
        peer = Peer(
            PeerTerms(
                limits,
                ReceiveBufferPool(2 * limits.message_bytes),
                AddressCount(),
                candidates=CANDIDATES,
                # Ends before the timeout of connecting, so that the error can name what was tried.
                connect_seconds=PATH_PART * min(address.seconds, LONGEST_SECONDS),
            ),
            servers,
            _refuse,
            address.host,
            reach=Reach.LOOPBACK if is_local(address.host) else Reach.PRIVATE,
            on_closed=partial(_closed, ended, opened),
        )
        tasks.start_soon(_hold, peer, ended)
        channel = peer.connection.createDataChannel(LABEL)

        def on_open() -> None:
            # Within the callback that reports the channel: no message can come before.
            self.path = peer.way
            attach(peer.link(channel), address.host, address.port)
            opened.set()

        channel.on("open", on_open)
        offer = await peer.describe()
        answer = await anyio.to_thread.run_sync(_post, address, offer.encode(), abandon_on_cancel=True)
        try:
            await peer.take_description(read_description(answer), "answer")
        except BadDescription as error:
            raise ConnectError(f"{address} answers what cannot be used: {error}") from error
        await opened.wait()
        if peer.closed:
            asked = ", ".join(server.url for server in servers) or "no STUN or TURN server"
            raise ConnectError(
                f"{address}: {peer.reason}; this side: {_kinds_of(offer)}; the robot: "
                f"{_kinds_of(answer.decode('utf-8', 'replace'))}; asked: {asked}",
                "no_path",
            )


def require_asyncio() -> None:
    """Raise ConnectError where the event loop is not asyncio's, on which alone aiortc runs."""
    if not runs_asyncio():
        raise ConnectError(
            "WebRTC needs asyncio (aiortc runs on nothing else), and this event loop is another"
        )


def _refuse(sink: Sink, info: PeerInfo) -> Never:
    raise Refused(403, "this side opens the channels")


def _closed(ended: anyio.Event, opened: anyio.Event, peer: Peer) -> None:
    ended.set()
    opened.set()


async def _hold(peer: Peer, ended: anyio.Event) -> None:
    """Keep a peer until it ends, or until this is cancelled."""
    try:
        await ended.wait()
    finally:
        with anyio.CancelScope(shield=True):
            await peer.close(1000, "closed by this side")


async def find_servers(address: RemoteAddress) -> tuple[IceServer, ...]:
    """Return the STUN and TURN servers: the given ones, or those of the robot.

    Raises:
        OSError: the server cannot be reached by HTTP.
        ConnectError: what names them cannot be used.
    """
    try:
        if address.ice_servers is not None:
            return read_ice_servers(address.ice_servers)
        status, body = await anyio.to_thread.run_sync(_ask, address, "GET", None, abandon_on_cancel=True)
        # Who refuses that, or does not know it, says why when it gets an offer.
        return read_configuration(body) if status == 200 else ()
    except BadIceServer as error:
        raise ConnectError(f"{address}: {error}") from error


def _post(address: RemoteAddress, offer: bytes) -> bytes:
    """Send an offer and return the answer. Blocks. Raises OSError and ConnectError."""
    status, body = _ask(address, "POST", offer)
    if status != 201:
        text = f"{address} refuses the offer: {_why(status, body)}"
        raise ConnectError(text, ConnectError.cause_of(status))
    return body


def _ask(address: RemoteAddress, method: str, content: bytes | None) -> tuple[int, bytes]:
    """Query the server's ``/webrtc`` and return status and body. Blocks. Raises OSError and ConnectError."""
    path, _, query = address.target.partition("?")
    target = f"{path.rstrip('/')}/{PATH}" + (f"?{query}" if query else "")
    connection = (
        http.client.HTTPConnection(address.host, address.port, timeout=REQUEST_SECONDS)
        if address.tls is None
        else http.client.HTTPSConnection(
            address.host, address.port, timeout=REQUEST_SECONDS, context=address.tls
        )
    )
    try:
        headers = dict(address.headers)
        if content is not None:
            headers |= {"Content-Type": "application/sdp", "Accept": "application/sdp"}
        connection.request(method, target, content, headers)
        response = connection.getresponse()
        body = response.read(OFFER_BYTES)
    except http.client.HTTPException as error:
        raise ConnectError(f"{address} does not speak HTTP: {error!r}") from error
    finally:
        connection.close()
    return response.status, body


def _why(status: int, body: bytes) -> str:
    text = body.decode("utf-8", "replace").strip().partition("\n")[0][:300]
    hint = "; is WebRTC on there (webrtc.enabled)?" if status in (404, 405) else ""
    return f"{status} {text if text.isprintable() else ascii(text)}{hint}"


def _kinds_of(description: str) -> str:
    """Return the kinds of candidates of a session description, for errors."""
    found = [line.split() for line in description.splitlines() if line.startswith("a=candidate:")]
    named = sorted({f"{words[7]} {words[4]}" for words in found if len(words) > 7})
    return ", ".join(named) or "none"
