"""Peer connection (W3C WebRTC, RFC 8829): description, data channels and end."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from time import monotonic
from typing import Final

from aiortc import RTCDataChannel, RTCIceCandidate, RTCSessionDescription

from rwt_protocol.states import StateEnum
from rwt_transports.background import ignore
from rwt_transports.connection import Connection, ListenerState
from rwt_transports.endpoint import Accept
from rwt_transports.errors import log_exception
from rwt_transports.http.addresses import AddressCount, holder_of, network_of
from rwt_transports.http.routes import is_local
from rwt_transports.limits import KIB, Limits
from rwt_transports.shared_pool import Holder
from rwt_transports.websocket.close_codes import GOING_AWAY
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.whole_messages import MessageWire
from rwt_webrtc.congestion.feedback import Feedback
from rwt_webrtc.packets.ice_guard import (
    CONSENT_EXPIRES_SECONDS,
    MEDIA_CONSENT_EXPIRES_SECONDS,
    CheckRates,
    IceGuard,
    Reach,
    reach_of,
)
from rwt_webrtc.transport.channels import ChannelLink
from rwt_webrtc.transport.ice_servers import IceServer, configuration
from rwt_webrtc.transport.sdp import BadDescription, Description, with_largest_message, without_addresses
from rwt_webrtc.upstream.peer_connection import GuardedPeerConnection

logger = logging.getLogger("rwt_webrtc.transport")

READY_BYTES: Final = 16 * KIB
"""Maximum bytes queued below a channel's lanes, where old messages can no longer be dropped."""
FRESH_READY_BYTES: Final = 1 * KIB
"""Maximum bytes queued below the lanes of a channel without retransmission: old messages are useless."""

RELEASE_SECONDS: Final = 0.5
"""Time after which an ended peer connection is not used any more."""


@dataclass(frozen=True, slots=True)
class PeerTerms:
    """Settings that all peers of one side share.

    Attributes:
        limits: limits of each channel's connection.
        buffers: counts the bytes of incomplete messages.
        addresses: number of connections by address; a channel counts as one.
        channels: maximum number of open data channels of a peer.
        candidates: maximum number of candidates of the other side, in its description and afterwards.
        connect_seconds: time within which the peers have to find each other.
        announce_private: True if private addresses are announced to peers with public ones, too.
        relay_only: True if only addresses of a TURN server are used.
        checks: rate limit of checks by network.
    """

    limits: Limits
    buffers: ReceiveBufferPool
    addresses: AddressCount
    channels: int = 16
    candidates: int = 64
    connect_seconds: float = 10.0
    announce_private: bool = False
    relay_only: bool = False
    checks: CheckRates = field(default_factory=CheckRates)

    def reach(self, address: str) -> Reach:
        """Return the addresses that are announced to a peer, by the address of its signalling."""
        return min(reach_of(address), Reach.PRIVATE) if self.announce_private else reach_of(address)


class PeerState(StateEnum):
    """State of a peer connection; :class:`Peer` has the drawing."""

    CONNECTING = "CONNECTED", "FAILED"
    CONNECTED = "LOST"
    FAILED = ()
    LOST = ()


class Peer:
    """Peer connection, from its first description to its end.

    Life cycle::

        CONNECTING ── path and handshake ──> CONNECTED ── fail(), close(), peer gone ──> LOST
            │
            └── fail(), close(), no path within `connect_seconds`, invalid description ──> FAILED

    * **CONNECTING**: descriptions and candidates are exchanged and checked.
    * **CONNECTED**: data channels and tracks carry messages and media.
    * **FAILED**, **LOST**: the peer has ended, without and with a path. A task closes aiortc's connection,
      and :data:`RELEASE_SECONDS` later its reference cycles are broken.

    Attributes by purpose:

    * Wiring: ``connection``, ``_terms``, ``_accept``, ``_guard``, ``_listeners`` (one for each data channel),
      ``on_feedback``.
    * Other side: ``_address``, ``_holder``, ``network``, ``ufrag``, ``largest``, ``_candidates``.
    * End: ``state``, ``reason``, ``_deadline``, ``_ending``, ``_on_closed``, ``_when_ended``.

    Args:
        terms: settings that it shares with other peers.
        servers: STUN and TURN servers, which help to find a path.
        accept: makes the endpoint of each data channel.
        address: address of the other side according to its signalling.
        reach: addresses that are announced to the other side, and to which checks are sent.
        on_closed: called once when it has ended.
        holder: client to which its incomplete messages count; by default that of the address.

    Attributes:
        connection: aiortc's connection.
        network: network of the other side; empty on this machine.
        largest: maximum size of a message that the other side takes; 0 for any.
        state: state of its life cycle.
        reason: reason of its end.
        on_feedback: called with transport-wide feedback of the other side.
    """

    def __init__(
        self,
        terms: PeerTerms,
        servers: tuple[IceServer, ...],
        accept: Accept,
        address: str = "",
        *,
        reach: Reach,
        on_closed: Callable[[Peer], None],
        holder: Holder | None = None,
    ) -> None:
        self._terms = terms
        self._accept = accept
        self._address = address
        self._holder = holder or holder_of(address)
        self.network = "" if not address or is_local(address) else network_of(address)
        self._guard = IceGuard(reach, partial(terms.checks.take, self.network))
        self._on_closed = on_closed
        self._candidates = 0
        self._listeners: list[ListenerState] = []
        self._ending: asyncio.Task[None] | None = None
        self._deadline: asyncio.TimerHandle | None = None
        self._when_ended: list[Callable[[], None]] = []
        self.ufrag = ""
        self.largest = 0
        self.state = PeerState.CONNECTING
        self.reason = ""
        self.on_feedback: Callable[[Feedback], None] = ignore
        self.connection = GuardedPeerConnection(
            configuration(servers, relay_only=terms.relay_only),
            terms.limits,
            terms.buffers,
            self._holder,
            self._guard,
            fail=self.fail,
            on_feedback=lambda feedback: self.on_feedback(feedback),
        )
        self.connection.on("connectionstatechange", self._state_changed)
        self.connection.on("datachannel", self._channel_opened)

    @property
    def connected(self) -> bool:
        """True if the peers have found each other, also after the end."""
        return self.state in (PeerState.CONNECTED, PeerState.LOST)

    @property
    def closed(self) -> bool:
        """True if it has ended."""
        return self.state in (PeerState.FAILED, PeerState.LOST)

    # -- descriptions --------------------------------------------------------------------------------------

    async def take_description(self, description: Description, kind: str) -> None:
        """Apply the other side's description.

        Raises:
            BadDescription: it cannot be used.
        """
        self.ufrag, self.largest = description.ufrag, description.largest
        self._candidates = description.candidates
        self._guard.described(len(description.text))
        try:
            await self.connection.setRemoteDescription(RTCSessionDescription(description.text, kind))
        except Exception as error:
            # aiortc raises whatever its reading comes across: AssertionError, KeyError, its own errors.
            raise BadDescription(
                f"the session description cannot be used: {error or type(error).__name__}"
            ) from error

    async def describe(self) -> str:
        """Gather candidates; returns this side's description, an offer or an answer, complete."""
        self._guard.consent_seconds = (
            MEDIA_CONSENT_EXPIRES_SECONDS if self.connection.sctp is None else CONSENT_EXPIRES_SECONDS
        )
        await self.connection.setLocalDescription()
        if self._deadline is None:
            loop = asyncio.get_running_loop()
            self._deadline = loop.call_later(self._terms.connect_seconds, self._too_late)
        text = without_addresses(self.connection.localDescription.sdp, self._guard.reach)
        return with_largest_message(text, self._terms.limits.message_bytes)

    async def add_candidates(self, candidates: tuple[RTCIceCandidate, ...], size: int) -> None:
        """Add candidates of the other side.

        Args:
            size: bytes of the request with them.

        Raises:
            BadDescription: there are too many.
        """
        self._candidates += len(candidates)
        if self._candidates > self._terms.candidates:
            most = self._terms.candidates
            raise BadDescription(f"{self._candidates} candidates; the limit is {most} (webrtc.candidates)")
        self._guard.described(size)
        for candidate in candidates:
            await self.connection.addIceCandidate(candidate)

    def _too_late(self) -> None:
        if not self.connected:
            self.fail(
                f"no path was found within {self._terms.connect_seconds:g} s (webrtc.connect_seconds): "
                f"{self._candidates} candidates of the other side"
            )

    # -- data channels -------------------------------------------------------------------------------------

    def _channel_opened(self, channel: RTCDataChannel) -> None:
        """Accept a channel of the other side as a connection of its own."""
        try:
            self._serve(channel)
        except Exception:
            log_exception("a data channel of %s could not be served", self._address)
            channel.close()

    def link(self, channel: RTCDataChannel) -> ChannelLink:
        """Return an open channel as a driver's link."""
        assert self.connection.association is not None  # It is there before any channel opens.
        return ChannelLink(self.connection.association, channel)

    def _serve(self, channel: RTCDataChannel) -> None:
        self._listeners = [each for each in self._listeners if each.connections]
        if len(self._listeners) >= self._terms.channels:
            logger.warning("no room for a data channel of %s (webrtc.channels)", self._address)
            channel.close()
            return
        link = self.link(channel)
        limits, credential = self._terms.limits, self._holder.credential
        listener = ListenerState(
            self._accept,
            MessageWire,
            replace(
                limits,
                ready_bytes=FRESH_READY_BYTES if link.is_fresh else READY_BYTES,
                outgoing_bytes=min(limits.outgoing_bytes, self.largest or limits.outgoing_bytes),
            ),
            None,
            "webrtc",
            max_message_size=self.largest,
            addresses=self._terms.addresses,
            buffers=self._terms.buffers,
            identify=lambda info: credential,  # Without a reference to this peer.
        )
        self._listeners.append(listener)
        listener.add(Connection(listener, link, self._address, 0), link)

    def tick(self) -> None:
        now = monotonic()
        for listener in self._listeners:
            listener.tick(now)

    @property
    def channels(self) -> int:
        return sum(bool(listener.connections) for listener in self._listeners)

    @property
    def way(self) -> str:
        """Description of the path to the other side; empty before it is found."""
        return self.connection.way

    # -- the end -------------------------------------------------------------------------------------------

    def _state_changed(self) -> None:
        state = self.connection.connectionState
        if state == "connected" and self.state is PeerState.CONNECTING:
            self.state = self.state.become(PeerState.CONNECTED)
            logger.info("a peer of %s is connected %s", self._address or "?", self.way)
        elif state in ("failed", "closed"):
            self.fail("the peer is gone" if self.connected else "no path was found, or the handshake failed")

    def fail(self, reason: str) -> None:
        """End it, without waiting for the other side."""
        if not self.closed:
            self.state = self.state.become(PeerState.LOST if self.connected else PeerState.FAILED)
            self.reason = reason
            logger.info("a peer of %s has ended: %s", self._address or "?", reason)
            self._ending = asyncio.get_running_loop().create_task(self._end())
            self._on_closed(self)
            for callback in self._when_ended:
                callback()

    def when_ended(self, callback: Callable[[], None]) -> None:
        self._when_ended.append(callback)

    async def close(self, code: int = GOING_AWAY, reason: str = "the server is going away") -> None:
        """Close the channels before the peer connection: the reverse is an error for the other side."""
        if not self.closed:
            await asyncio.gather(*(listener.end(code, reason) for listener in self._listeners))
            self.fail(reason)
        if self._ending is not None:
            await self._ending

    async def _end(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
        try:
            # The association ends its channels, and they their connections.
            await self.connection.close()
        except Exception:
            log_exception("a peer connection could not be closed")
        for listener in self._listeners:
            for connection in tuple(listener.connections):
                connection.abort()
        self._when_ended.clear()
        self.on_feedback = ignore
        # aiortc's tasks that connect end after the next turns of the loop.
        asyncio.get_running_loop().call_later(RELEASE_SECONDS, self.connection.release)
