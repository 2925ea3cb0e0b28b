"""The client's side: an offer by HTTP to a server's ``/webrtc``, and a data channel (asyncio only)."""

from __future__ import annotations

import http.client
from functools import partial
from typing import TYPE_CHECKING, Final, Never

import anyio
import anyio.to_thread

from rwt_transports.background import runs_asyncio
from rwt_transports.errors import ConnectError, Refused
from rwt_transports.http import is_local
from rwt_transports.limits import AddressCount
from rwt_transports.webrtc.peer import Peer, PeerTerms
from rwt_transports.webrtc.sdp import CANDIDATES, OFFER_BYTES, BadDescription, read_description
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

if TYPE_CHECKING:
    from anyio.abc import TaskGroup

    from rwt_protocol.transport import PeerInfo, Sink
    from rwt_transports.api import Attach, RemoteAddress

LABEL: Final = "rosbridge"
PATH: Final = "webrtc"
REQUEST_SECONDS: Final = 20.0


class DataChannelConnector:
    """Opens a data channel to a server; satisfies :class:`rwt_transports.api.Connector`.

    The channel is ordered and loses nothing.
    """

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Reach the server by HTTP, find a path to it, and attach the channel once it is open.

        Raises:
            OSError: nobody answers by HTTP.
            ConnectError: the server refuses the offer, or no path to it was found; or the event loop is not
                asyncio's.
        """
        require_asyncio()
        limits = address.limits
        ended, opened = anyio.Event(), anyio.Event()
        peer = Peer(
            PeerTerms(
                limits, ReceiveBufferPool(2 * limits.message_bytes), AddressCount(), candidates=CANDIDATES
            ),
            (),
            _refuse,
            address.host,
            loopback=is_local(address.host),
            on_closed=partial(_closed, ended, opened),
        )
        tasks.start_soon(_hold, peer, ended)
        channel = peer.connection.createDataChannel(LABEL)
        peer.prepare()

        def on_open() -> None:
            # Within the callback that reports the channel: no message can come before.
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
            raise ConnectError(f"{address}: {peer.reason}")


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


def _post(address: RemoteAddress, offer: bytes) -> bytes:
    """Send an offer; returns the answer. Blocks; raises OSError and ConnectError."""
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
        headers = {**address.headers, "Content-Type": "application/sdp", "Accept": "application/sdp"}
        connection.request("POST", target, offer, headers)
        response = connection.getresponse()
        body = response.read(OFFER_BYTES)
    except http.client.HTTPException as error:
        raise ConnectError(f"{address} does not speak HTTP: {error!r}") from error
    finally:
        connection.close()
    if response.status != 201:
        raise ConnectError(f"{address} refuses the offer: {_why(response.status, body)}")
    return body


def _why(status: int, body: bytes) -> str:
    text = body.decode("utf-8", "replace").strip().partition("\n")[0][:300]
    hint = "; is WebRTC on there (webrtc.enabled)?" if status in (404, 405) else ""
    return f"{status} {text if text.isprintable() else ascii(text)}{hint}"
