"""Signalling: an HTTP offer and an answer, as in WHIP and WHEP (RFC 9725).

- ``GET`` returns the STUN and TURN servers, as a JSON ``RTCConfiguration`` of the W3C's.
- ``POST`` of ``application/sdp`` opens a peer: ``201``, the answer, and its URL in ``Location``.
- ``PATCH`` of ``application/trickle-ice-sdpfrag`` (RFC 8840) to that URL adds candidates: ``204``.
- ``DELETE`` of that URL ends the peer: ``200``.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Never

import anyio

from rwt_transports.background import background_tasks
from rwt_transports.connection import TICK_SECONDS
from rwt_transports.endpoint import Accept, Endpoint, PeerInfo, Sink
from rwt_transports.errors import Refused
from rwt_transports.http.routes import (
    AnyReader,
    Audience,
    HttpRequest,
    HttpResponse,
    MetricFamily,
    Reader,
    Route,
)
from rwt_transports.shared_pool import RETRY_SECONDS, Holder, PoolFull, PoolRow, Share, SharedPool
from rwt_transports.websocket.close_codes import TRY_AGAIN_LATER
from rwt_webrtc.transport.ice_servers import IceServer
from rwt_webrtc.transport.peer import Peer, PeerTerms
from rwt_webrtc.transport.sdp import BadDescription, read_description, read_fragment

SDP: Final = "application/sdp"
FRAGMENT: Final = "application/trickle-ice-sdpfrag"

FindIceServers = Callable[[], Awaitable[tuple[IceServer, ...]]]
"""Finds the STUN and TURN servers of a new peer; their credentials may be temporary. Raises Refused if there
are none.
"""


PEERS: Final = PoolRow("WebRTC peers", "webrtc.peers", "peer connections")
HANDSHAKES: Final = PoolRow("WebRTC handshakes", "webrtc.handshakes", "connecting peers")
OFFERS: Final = PoolRow("waiting WebRTC offers", "webrtc.handshakes", "bytes of waiting offers")


@dataclass(frozen=True, slots=True)
class PeerBounds:
    """Limits of all peers of a server together.

    Attributes:
        peers: maximum number of open peers.
        handshakes: maximum number of peers that are still connecting.
        queue_seconds: maximum time for which an offer waits until fewer peers are connecting.
        queue_bytes: maximum size of the waiting offers.
    """

    peers: int = 32
    handshakes: int = 8
    queue_seconds: float = 5.0
    queue_bytes: int = 1024 * 1024


class _Admitted:
    """Shares of one peer, from its offer to its end.

    Attributes:
        identifier: last part of the peer's URL.
        peer: the peer; None before it is made.
        present: share of the open peers.
        handshake: share of the connecting peers; released once the peer is connected.
        taken: reason why the pool has taken a share; empty while it has not.
    """

    __slots__ = ("_changed", "_ending", "handshake", "identifier", "peer", "present", "taken")

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._ending: asyncio.Task[None] | None = None
        self.identifier = secrets.token_urlsafe(18)
        self.peer: Peer | None = None
        self.present: Share | None = None
        self.handshake: Share | None = None
        self.taken = ""

    def end(self, reason: str) -> None:
        """End the peer in favour of another client. An offer that still waits is refused."""
        if not self.taken:
            self.taken = reason
            if self.peer is not None:
                closing = self.peer.close(TRY_AGAIN_LATER, reason)
                self._ending = asyncio.get_running_loop().create_task(closing)
            self._changed()

    def check(self) -> None:
        """Raise Refused if a share was taken."""
        if self.taken:
            raise Refused(503, self.taken, {"Retry-After": str(RETRY_SECONDS)})


class Peers:
    """Peer connections that a server has accepted.

    Args:
        terms: settings that all peers share.
        bounds: limits of all peers together.
        find_servers: finds the STUN and TURN servers of a new peer.
    """

    def __init__(self, terms: PeerTerms, bounds: PeerBounds, find_servers: FindIceServers) -> None:
        self.terms = terms
        self._bounds = bounds
        self.find_servers = find_servers
        self._peers: dict[str, Peer] = {}
        self._admitted: set[_Admitted] = set()
        self._present = SharedPool(PEERS, bounds.peers)
        self._handshakes = SharedPool(HANDSHAKES, bounds.handshakes)
        self._offers = SharedPool(OFFERS, bounds.queue_bytes)
        self._ended: dict[str, int] = {"connected": 0, "unconnected": 0}
        self._refused = 0
        self._closing = False
        self._changed = anyio.Event()

    def __len__(self) -> int:
        return len(self._peers)

    def find(self, identifier: str) -> Peer | None:
        return self._peers.get(identifier)

    async def open(
        self,
        request: HttpRequest,
        holder: Holder,
        accept: Accept,
        answer: Callable[[Peer], Awaitable[str]],
    ) -> HttpResponse:
        """Open a peer for a request with an offer, and return the response.

        Waits while the maximum number of peers is connecting.

        Args:
            holder: client to which the peer counts.
            accept: makes the endpoint of each data channel.
            answer: applies the offer to the new peer, and returns the answer.

        Raises:
            Refused: a limit is reached, or the STUN and TURN servers are not available.
            BadDescription: the offer is not usable.
        """
        admitted = _Admitted(self._notify)
        self._admitted.add(admitted)
        try:
            await self._admit(admitted, holder, len(request.body))
            servers = await self.find_servers()
            admitted.check()
            peer = self._make(request, holder, accept, servers, admitted)
        except BaseException:
            self._release(admitted)
            raise
        try:
            text = await answer(peer)
            admitted.check()
        except BaseException:
            peer.fail("its description could not be used")
            raise
        location = f"{request.prefix}{request.path}/{admitted.identifier}"
        headers = {"Location": location, "Cache-Control": "no-store"}
        if servers:
            headers["Link"] = ", ".join(server.link for server in servers)
        return HttpResponse(text.encode(), 201, SDP, headers)

    def _make(
        self,
        request: HttpRequest,
        holder: Holder,
        accept: Accept,
        servers: tuple[IceServer, ...],
        admitted: _Admitted,
    ) -> Peer:
        def closed(peer: Peer) -> None:
            self._release(admitted)
            self._closed(admitted.identifier, peer)

        peer = Peer(
            self.terms,
            servers,
            accept,
            request.address,
            reach=self.terms.reach(request.address),
            on_closed=closed,
            holder=holder,
        )
        self._peers[admitted.identifier] = admitted.peer = peer
        return peer

    async def _admit(self, admitted: _Admitted, holder: Holder, size: int) -> None:
        """Take the shares of a new peer; wait for some seconds until fewer peers are connecting.

        Raises:
            Refused: there is no room, or too many bytes wait already.
        """
        try:
            if self._closing:
                raise Refused(503, "the server is going away")
            admitted.present = self._present.take(holder, admitted.end)
            self._release_connected()
            try:
                admitted.handshake = self._handshakes.take(holder, admitted.end)
            except PoolFull as full:
                await self._wait(admitted, holder, size, full)
            admitted.check()
        except Refused:
            self._refused += 1
            raise

    async def _wait(self, admitted: _Admitted, holder: Holder, size: int, refused: PoolFull) -> None:
        """Wait until fewer peers are connecting; raises `refused` if that takes too long."""
        offer = self._offers.take(holder, admitted.end, size)
        try:
            with anyio.move_on_after(self._bounds.queue_seconds):
                while admitted.handshake is None and not admitted.taken:
                    await self._changed.wait()
                    self._release_connected()
                    with suppress(PoolFull):
                        admitted.handshake = self._handshakes.take(holder, admitted.end)
        finally:
            self._offers.release(offer)
        if admitted.handshake is None and not admitted.taken:
            raise refused

    def _release_connected(self) -> None:
        """Release the handshakes of the peers that are connected by now."""
        for each in self._admitted:
            if each.handshake is not None and each.peer is not None and each.peer.connected:
                self._handshakes.release(each.handshake)

    def _release(self, admitted: _Admitted) -> None:
        self._admitted.discard(admitted)
        admitted.peer = None  # Break the cycle: the peer's callback refers to this object.
        for pool, share in ((self._present, admitted.present), (self._handshakes, admitted.handshake)):
            if share is not None:
                pool.release(share)

    def _closed(self, identifier: str, peer: Peer) -> None:
        self._peers.pop(identifier, None)
        self._ended["connected" if peer.connected else "unconnected"] += 1
        self._notify()

    def _notify(self) -> None:
        changed, self._changed = self._changed, anyio.Event()
        changed.set()

    async def watch(self) -> None:
        """Check the time-outs of every connection, until cancelled."""
        while True:
            for peer in tuple(self._peers.values()):
                peer.tick()
            self._notify()
            await anyio.sleep(TICK_SECONDS)

    async def close(self) -> None:
        self._closing = True
        await asyncio.gather(*(peer.close() for peer in tuple(self._peers.values())))

    def metrics(self) -> Iterable[MetricFamily]:
        peers = tuple(self._peers.values())
        connected = sum(peer.connected for peer in peers)
        states = [({"state": "connected"}, connected), ({"state": "connecting"}, len(peers) - connected)]
        ended = [({"was": was}, number) for was, number in self._ended.items()]
        channels = sum(peer.channels for peer in peers)
        yield MetricFamily("rwt_webrtc_peers", "gauge", "Peer connections that are open.", states)
        yield MetricFamily("rwt_webrtc_channels", "gauge", "Data channels that are open.", [({}, channels)])
        yield MetricFamily("rwt_webrtc_ended_total", "counter", "Peer connections that have ended.", ended)
        yield MetricFamily(
            "rwt_webrtc_refused_total", "counter", "Offers refused for want of room.", [({}, self._refused)]
        )


@asynccontextmanager
async def open_peers(
    terms: PeerTerms, bounds: PeerBounds, find_servers: FindIceServers
) -> AsyncIterator[Peers]:
    """Accept peers within the block, and close them at its end."""
    peers = Peers(terms, bounds, find_servers)
    async with background_tasks() as tasks:
        tasks.start_soon(peers.watch)
        try:
            yield peers
        finally:
            with anyio.CancelScope(shield=True):
                await peers.close()


def data_routes(peers: Peers, accept: Accept) -> tuple[Route[Reader], ...]:
    """Return the routes of ``/webrtc``, whose data channels go to `accept` as connections of one listener."""

    async def offered(reader: Reader, request: HttpRequest) -> HttpResponse:
        offer = read_description(request.body, peers.terms.candidates)
        if offer.media != ("application",):
            raise BadDescription(
                f"sections {', '.join(offer.media) or 'none'} are offered, where /webrtc takes one of data "
                "channels: create a channel before the offer; for video POST to /whep"
            )

        async def answer(peer: Peer) -> str:
            peer.when_ended(reader.while_allowed((), peer.fail))
            await peer.take_description(offer, "offer")
            return await peer.describe()

        return await peers.open(request, reader.holder, _on_behalf(request, accept), answer)

    async def configured(request: HttpRequest, reader: Reader) -> HttpResponse:
        try:
            servers = await peers.find_servers()
        except Refused as refused:
            return HttpResponse.refusing(refused)
        body = {"iceServers": [server.dictionary for server in servers]}
        headers = {"Cache-Control": "no-store"}
        return HttpResponse(json.dumps(body).encode(), content_type="application/json", headers=headers)

    return (Route("/webrtc", configured, Audience.ADMITTED), *offer_routes(peers, "webrtc", offered))


def _on_behalf(request: HttpRequest, accept: Accept) -> Accept:
    """Accept channels with the credentials of the offer: same token, same origin."""

    def accept_channel(sink: Sink, info: PeerInfo) -> Endpoint:
        target = f"{request.path}?{request.query}" if request.query else request.path
        return accept(sink, replace(info, path=target, headers=request.headers))

    return accept_channel


def refuse_channels(sink: Sink, info: PeerInfo) -> Never:
    """Reject the data channels of a peer that was opened for media."""
    raise Refused(403, "data channels are offered at /webrtc")


def offer_routes(
    peers: Peers, feature: str, offered: Callable[[AnyReader, HttpRequest], Awaitable[HttpResponse]]
) -> tuple[Route[AnyReader], ...]:
    """Return the routes of offers at the path of a feature, and of the peers that they open."""

    def post(request: HttpRequest, reader: AnyReader) -> Awaitable[HttpResponse]:
        return _answering(request, SDP, partial(offered, reader))

    def patch(request: HttpRequest, reader: AnyReader) -> Awaitable[HttpResponse]:
        return _answering(request, FRAGMENT, partial(_add_candidates, peers))

    async def delete(request: HttpRequest, reader: AnyReader) -> HttpResponse:
        peer = peers.find(_identifier(request))
        if peer is None:
            return _gone()
        await peer.close(1000, "the client has ended it")
        return HttpResponse(b"ended\n")

    return (
        Route(f"/{feature}", post, Audience.ADMITTED, "POST", feature=feature),
        Route(f"/{feature}/*", patch, Audience.ADMITTED, "PATCH"),
        Route(f"/{feature}/*", delete, Audience.ADMITTED, "DELETE"),
    )


async def _add_candidates(peers: Peers, request: HttpRequest) -> HttpResponse:
    peer = peers.find(_identifier(request))
    if peer is None:
        return _gone()
    fragment = read_fragment(request.body)
    if fragment.ufrag and fragment.ufrag != peer.ufrag:
        # RFC 9725 section 4.3.2: what cannot be restarted answers 422.
        text = "an ICE restart is not possible here: DELETE this, and POST an offer\n"
        return HttpResponse(text.encode(), 422)
    await peer.add_candidates(fragment.candidates, len(request.body))
    return HttpResponse(status=204)


def _identifier(request: HttpRequest) -> str:
    return request.path.rpartition("/")[2]


def _gone() -> HttpResponse:
    return HttpResponse(b"there is no such peer, or it has ended: POST an offer\n", 404)


async def _answering(
    request: HttpRequest, wanted: str, handler: Callable[[HttpRequest], Awaitable[HttpResponse]]
) -> HttpResponse:
    """Return the response of `handler`, or why it failed."""
    given = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if given != wanted:
        text = f"the body is {given or 'of no type'}, where {wanted} is wanted\n"
        return HttpResponse(text.encode(), 415, headers={"Accept-Post": wanted})
    try:
        return await handler(request)
    except Refused as refused:
        return HttpResponse.refusing(refused)
    except BadDescription as error:
        return HttpResponse(f"{error}\n".encode(), 400)
