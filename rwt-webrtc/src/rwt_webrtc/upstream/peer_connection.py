"""Peer connection whose transports are those of this package.

Borrows :class:`aiortc.RTCPeerConnection`, which makes its transports itself and takes none. Private names,
and why each is needed:

* ``__createDtlsTransport``: make the DTLS and ICE transports of a section.
* ``__createSctpTransport``: make the association of the data channels.
* ``__dtlsTransports``, ``__iceTransports``: the transports that aiortc closes and whose states it combines.
* ``__updateConnectionState``, ``__updateIceConnectionState``, ``__updateIceGatheringState``: combine their
  states whenever one changes.
* ``__sctp``: the association that descriptions and data channels use.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Any, cast

from aiortc import RTCCertificate, RTCConfiguration, RTCIceTransport, RTCPeerConnection

from rwt_transports.background import ignore
from rwt_transports.limits import Limits
from rwt_transports.shared_pool import Holder
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_webrtc.congestion.feedback import Feedback
from rwt_webrtc.packets.ice_guard import IceGuard
from rwt_webrtc.upstream.association import Association
from rwt_webrtc.upstream.certificate import AnyCertificate
from rwt_webrtc.upstream.dtls_transport import GuardedDtlsTransport
from rwt_webrtc.upstream.ice_agent import GuardedAgent, GuardedGatherer
from rwt_webrtc.upstream.rtp_sender import PacedSender

# aioice logs each step of each candidate pair at INFO, 50 kB per second if clients wish, and aiortc each
# frame that cannot be decoded as a warning. An application that sets a level for these loggers keeps it.
for _name, _level in (("aioice", logging.WARNING), ("aiortc.rtcrtpreceiver", logging.ERROR)):
    if logging.getLogger(_name).level == logging.NOTSET:
        logging.getLogger(_name).setLevel(_level)


class GuardedPeerConnection(RTCPeerConnection):
    """Peer connection with limits.

    Args:
        limits: limits of each data channel.
        buffers: counts the bytes of incomplete messages.
        holder: client to which they count.
        guard: limits of its ICE agents.
        fail: ends the peer for a reason.
        on_feedback: called with transport-wide feedback of the other side.

    Attributes:
        association: SCTP association of the data channels; None without data channels.
    """

    def __init__(
        self,
        configuration: RTCConfiguration,
        limits: Limits,
        buffers: ReceiveBufferPool,
        holder: Holder,
        guard: IceGuard,
        fail: Callable[[str], None],
        on_feedback: Callable[[Feedback], None],
    ) -> None:
        super().__init__(configuration)
        self.association: Association | None = None
        self._make_association = partial(
            Association, limits=limits, buffers=buffers, holder=holder, fail=fail
        )
        self._make_gatherer = partial(GuardedGatherer, configuration, guard)
        self._own_certificates: list[RTCCertificate] = [AnyCertificate.generateCertificate()]
        self._on_feedback = on_feedback
        self._agents: list[GuardedAgent] = []
        self._handshakes: list[GuardedDtlsTransport] = []

    def _RTCPeerConnection__createDtlsTransport(self) -> GuardedDtlsTransport:
        """Make the transports of a section; those of further ones have the credentials of the first one."""
        private = cast("Any", self)
        first = self._handshakes[0].transport.iceGatherer.getLocalParameters() if self._handshakes else None
        gatherer = self._make_gatherer(first)
        gatherer.on("statechange", private._RTCPeerConnection__updateIceGatheringState)
        ice = RTCIceTransport(gatherer)
        ice.on("statechange", private._RTCPeerConnection__updateIceConnectionState)
        ice.on("statechange", private._RTCPeerConnection__updateConnectionState)
        handshake = GuardedDtlsTransport(ice, self._own_certificates, self._on_feedback)
        handshake.on("statechange", private._RTCPeerConnection__updateConnectionState)
        private._RTCPeerConnection__iceTransports.add(ice)
        private._RTCPeerConnection__dtlsTransports.add(handshake)
        self._agents.append(gatherer.agent)
        self._handshakes.append(handshake)
        private._RTCPeerConnection__updateIceGatheringState()
        private._RTCPeerConnection__updateIceConnectionState()
        private._RTCPeerConnection__updateConnectionState()
        return handshake

    def _RTCPeerConnection__createSctpTransport(self) -> None:
        """Make the association; the configuration never bundles all sections before they are negotiated."""
        association = self._make_association(self._RTCPeerConnection__createDtlsTransport())
        association.on("datachannel", partial(self.emit, "datachannel"))
        self.association = cast("Any", self)._RTCPeerConnection__sctp = association

    @property
    def way(self) -> str:
        """Description of the paths to the other side; empty before they are found."""
        return "; ".join(filter(None, (agent.way for agent in self._agents)))

    def release(self) -> None:
        """Break the reference cycles of a connection that has been closed for a while.

        The server rarely collects cyclic garbage, and freezes what it has seen alive.
        """
        for sender in self.getSenders():
            if isinstance(sender, PacedSender):
                sender.release()
        for agent in self._agents:
            agent.release()
        for handshake in self._handshakes:
            handshake.release()
        self._on_feedback = ignore
        del self._make_association
