"""Peer connection (W3C WebRTC, RFC 8829): description, data channels and end."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from time import monotonic
from typing import Final

from aiortc import RTCDataChannel, RTCIceCandidate, RTCIceTransport, RTCPeerConnection, RTCSessionDescription

from rwt_transports.connection import Connection, ListenerState
from rwt_transports.endpoint import Accept
from rwt_transports.errors import log_exception
from rwt_transports.http.addresses import AddressCount, network_of
from rwt_transports.http.routes import is_local
from rwt_transports.limits import KIB, Limits
from rwt_transports.websocket.close_codes import GOING_AWAY
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.whole_messages import MessageWire
from rwt_webrtc.transport.aiortc_internals import Association, GuardedHandshake, release
from rwt_webrtc.transport.channels import ChannelLink
from rwt_webrtc.transport.congestion.feedback import Feedback
from rwt_webrtc.transport.ice_agent import GuardedAgent, way
from rwt_webrtc.transport.ice_guard import (
    CONSENT_EXPIRES_SECONDS,
    MEDIA_CONSENT_EXPIRES_SECONDS,
    CheckRates,
    IceGuard,
    Reach,
    reach_of,
)
from rwt_webrtc.transport.ice_servers import IceServer, configuration
from rwt_webrtc.transport.sdp import BadDescription, Description, with_largest_message, without_addresses

logger = logging.getLogger("rwt_webrtc.transport")

READY_BYTES: Final = 16 * KIB
"""Maximum bytes queued below a channel's lanes, where old messages can no longer be dropped."""
FRESH_READY_BYTES: Final = 1 * KIB
"""The same for a channel without retransmission, where an old message is worth nothing."""

RELEASE_SECONDS: Final = 0.5
"""Time after which an ended peer connection is not used any more."""


@dataclass(frozen=True, slots=True)
class PeerTerms:
    """Settings that all peers of one side share.

    Attributes:
        limits: bounds of each channel's connection.
        buffers: where is counted what has come of large messages.
        addresses: number of connections by address; a channel counts as one.
        channels: data channels that a peer may have open.
        candidates: of the other side, in its description and afterwards.
        connect_seconds: how long it may take until the peers have found each other.
        tell_private: True if peers with public addresses are told private ones, too.
        relay_only: True if only addresses of a TURN server are used.
        checks: rate limit of checks by network.
    """

    limits: Limits
    buffers: ReceiveBufferPool
    addresses: AddressCount
    channels: int = 16
    candidates: int = 64
    connect_seconds: float = 10.0
    tell_private: bool = False
    relay_only: bool = False
    checks: CheckRates = field(default_factory=CheckRates)

    def reach(self, address: str) -> Reach:
        """Return which addresses a peer is told, by the address of its signalling."""
        return min(reach_of(address), Reach.PRIVATE) if self.tell_private else reach_of(address)


class Peer:
    """Peer connection, from its first description to its end.

    Args:
        terms: what it may take.
        servers: that help to find a path.
        accept: makes the endpoint of each data channel.
        address: address of the other side, as far as its signalling tells.
        reach: addresses that the other side is told, and to which checks are sent.
        on_closed: called once when it has ended.

    Attributes:
        connection: aiortc's.
        network: that the other side counts as; empty on this machine.
        largest: bytes of the largest message that the other side takes; 0 for any.
        connected: True if the peers have found each other.
        closed: True if it has ended.
        reason: why it has.
        on_feedback: called with transport-wide feedback of the other side; None to ignore it.
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
    ) -> None:
        self._terms = terms
        self._accept = accept
        self._address = address
        self.network = "" if not address or is_local(address) else network_of(address)
        self._guard = IceGuard(reach, partial(terms.checks.take, self.network))
        self._on_closed = on_closed
        self._candidates = 0
        self._states: list[ListenerState] = []
        self._prepared: set[RTCIceTransport] = set()
        self._association: Association | None = None
        self._ending: asyncio.Task[None] | None = None
        self._deadline: asyncio.TimerHandle | None = None
        self._when_ended: list[Callable[[], None]] = []
        self.ufrag = ""
        self.largest = 0
        self.connected = False
        self.closed = False
        self.reason = ""
        self.on_feedback: Callable[[Feedback], None] | None = None
        self.connection = RTCPeerConnection(configuration(servers, relay_only=terms.relay_only))
        self.connection.on("connectionstatechange", self._state_changed)
        self.connection.on("datachannel", self._channel_opened)

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
        self.prepare()

    def prepare(self) -> None:
        """Prepare aiortc's objects, before candidates are gathered."""
        connection = self.connection
        sctp = connection.sctp
        handshakes = {each.sender.transport for each in connection.getTransceivers()}
        if sctp is not None:
            handshakes.add(sctp.transport)
            if self._association is None:
                self._association = Association.adopt(
                    sctp, self._terms.limits, self._terms.buffers, self.fail
                )
        self._guard.consent_seconds = (
            MEDIA_CONSENT_EXPIRES_SECONDS if sctp is None else CONSENT_EXPIRES_SECONDS
        )
        for handshake in handshakes:
            if handshake.transport not in self._prepared:
                GuardedHandshake.adopt(handshake, self._take_feedback)
                GuardedAgent.adopt(handshake.transport, self._guard)
                self._prepared.add(handshake.transport)

    async def describe(self) -> str:
        """Gather candidates; returns this side's description, an offer or an answer, complete."""
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

    def _take_feedback(self, feedback: Feedback) -> None:
        if self.on_feedback is not None:
            self.on_feedback(feedback)

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
        assert self._association is not None  # It is there before any channel opens.
        return ChannelLink(self._association, channel, deque())

    def _serve(self, channel: RTCDataChannel) -> None:
        self._states = [state for state in self._states if state.connections]
        if len(self._states) >= self._terms.channels:
            logger.warning("no room for a data channel of %s (webrtc.channels)", self._address)
            channel.close()
            return
        link = self.link(channel)
        limits = self._terms.limits
        state = ListenerState(
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
        )
        self._states.append(state)
        state.add(Connection(state, link, self._address, 0), link)

    def tick(self) -> None:
        now = monotonic()
        for state in self._states:
            state.tick(now)

    @property
    def channels(self) -> int:
        return sum(bool(state.connections) for state in self._states)

    @property
    def way(self) -> str:
        """Description of the path to the other side; empty before it is found."""
        return "; ".join(filter(None, (way(transport) for transport in self._prepared)))

    # -- the end -------------------------------------------------------------------------------------------

    def _state_changed(self) -> None:
        state = self.connection.connectionState
        if state == "connected" and not self.connected:
            self.connected = True
            logger.info("a peer of %s is connected %s", self._address or "?", self.way)
        elif state in ("failed", "closed"):
            self.fail("the peer is gone" if self.connected else "no path was found, or the handshake failed")

    def fail(self, reason: str) -> None:
        """End it, without waiting for the other side."""
        if not self.closed:
            self.closed = True
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
            await asyncio.gather(*(state.end(code, reason) for state in self._states))
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
        for state in self._states:
            for connection in tuple(state.connections):
                connection.abort()
        self._when_ended.clear()
        self.on_feedback = None
        # aiortc's tasks that connect end after the next turns of the loop.
        asyncio.get_running_loop().call_later(RELEASE_SECONDS, release, self.connection)
