"""ICE agent (RFC 8445): aioice's, with limits, further candidates and quick detection of a lost peer.

aioice answers requests without credentials, takes what it cannot parse for data, queues data of any address
without limit, and notices a lost peer after half a minute. It offers no public way to change that, so this
module uses its private names. aioice is pinned below 0.14, and
`tests/extensions/webrtc/test_private_names.py` checks them.
"""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Coroutine, Sequence
from struct import Struct
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, cast

from aioice import Candidate, Connection, TransportPolicy, stun, turn
from aioice.ice import StunProtocol, relayed_candidate, server_reflexive_candidate

from rwt_transports.limits import RateLimit
from rwt_webrtc.transport.ice_guard import (
    DATAGRAM_BYTES,
    EARLY_DATAGRAMS,
    WAITING_DATAGRAMS,
    IceGuard,
    Reach,
    is_unicast,
)
from rwt_webrtc.transport.stun_messages import TURN_METHODS, BadStun, StunClass, check_stun

if TYPE_CHECKING:
    from aiortc import RTCIceTransport


logger = logging.getLogger("rwt_webrtc.transport")

CONSENT_SECONDS: Final = 0.7
"""Interval of consent checks (RFC 7675) in seconds."""
CONSENT_ASKED: Final = 3
"""Consent checks without response before the peer is lost; a count, because a suspended process cannot
receive.
"""
LOOPBACK: Final = "127.0.0.1"
GATHER_SECONDS: Final = 2
"""Timeout of STUN and TURN servers in seconds, so that an unreachable one does not delay peers that need
none.
"""
_STUN_BYTES: Final = 4
_DTLS_BYTES: Final = 20
_MEDIA_BYTES: Final = 128
"""First bytes from which on a datagram is not STUN, is DTLS, and is SRTP or SRTCP (RFC 7983)."""


class GuardedAgent(Connection):
    """ICE agent of a peer.

    Attributes:
        guard: limits of the agent; the loopback address, which aioice omits, is a candidate if the other side
            may be on this machine.
    """

    guard: IceGuard

    @classmethod
    def adopt(cls, transport: RTCIceTransport, guard: IceGuard) -> None:
        """Convert the agent of a transport, before it gathers candidates."""
        agent = transport.iceGatherer._connection
        agent.__class__ = cls  # The transport does not take one.
        cast("GuardedAgent", agent).guard = guard

    async def get_component_candidates(
        self,
        component: int,
        addresses: list[str],
        timeout: int = 0,  # noqa: ASYNC109 - the signature is aioice's
    ) -> list[Candidate]:
        """Gather candidates on addresses; none if only relays are used."""
        # Servers are asked when the sockets are guarded, since that may take seconds.
        stun_server, self.stun_server = self.stun_server, None
        turn_server, self.turn_server = self.turn_server, None
        is_here = addresses and self.guard.reach is Reach.LOOPBACK
        found = await super().get_component_candidates(
            component, [*addresses, LOOPBACK] if is_here else addresses
        )
        for protocol in self._protocols:
            protocol.__class__ = GuardedProtocol  # aioice makes them.
            cast("GuardedProtocol", protocol).guard = self.guard
        asked: list[Coroutine[Any, Any, tuple[Candidate, StunProtocol | None]]] = []
        if stun_server is not None:
            ipv4 = [each for each in self._protocols if ":" not in each.local_candidate.host]
            asked += [server_reflexive_candidate(each, stun_server) for each in ipv4]
        if turn_server is not None:
            asked.append(self._relayed(component, turn_server))
        return found + await self._answers(asked, timeout or GATHER_SECONDS)

    def _relayed(
        self, component: int, server: tuple[str, int]
    ) -> Coroutine[Any, Any, tuple[Candidate, StunProtocol]]:
        return relayed_candidate(
            component=component,
            hide_related_address=self._transport_policy == TransportPolicy.RELAY,
            protocol_factory=self._protocol,
            turn_server=server,
            turn_username=self.turn_username,
            turn_password=self.turn_password,
            turn_ssl=self.turn_ssl,
            turn_transport=self.turn_transport,
        )

    def _protocol(self) -> GuardedProtocol:
        protocol = GuardedProtocol(self)
        protocol.guard = self.guard
        return protocol

    async def _answers(
        self, asked: Sequence[Coroutine[Any, Any, tuple[Candidate, StunProtocol | None]]], seconds: float
    ) -> list[Candidate]:
        """Return the candidates that servers know within some seconds."""
        if not asked:
            return []
        done, pending = await asyncio.wait([asyncio.create_task(each) for each in asked], timeout=seconds)
        for task in pending:
            task.cancel()
        found: list[Candidate] = []
        for task in done:
            if task.exception() is None:
                candidate, protocol = task.result()
                if protocol is not None:
                    self._protocols.append(protocol)
                if is_unicast(candidate.host, candidate.port):
                    found.append(candidate)
        return found

    def data_received(self, data: bytes, component: int) -> None:
        """Queue a datagram, or drop it if too many wait."""
        if self._queue.qsize() < (WAITING_DATAGRAMS if self._nominated else EARLY_DATAGRAMS):
            self._queue.put_nowait((data, component))

    async def query_consent(self) -> None:
        """Ask the peer repeatedly whether it still consents to receive, until it does not answer."""
        now = asyncio.get_running_loop().time
        asked: list[asyncio.Task[bool]] = []
        answered, unanswered = now(), 0
        try:
            while now() - answered < self.guard.consent_seconds or unanswered < CONSENT_ASKED:
                unanswered += 1
                asked.append(asyncio.create_task(self._consents()))
                await asyncio.sleep(CONSENT_SECONDS * (0.8 + 0.4 * random.random()))
                if any(task.done() and task.result() for task in asked):
                    answered, unanswered = now(), 0
                asked = [task for task in asked if not task.done()]
        finally:
            for task in asked:
                task.cancel()
        logger.info("a peer does not answer any more, counted as gone")
        self._query_consent_task = None  # This task, for which closing would wait.
        await self.close()

    async def _consents(self) -> bool:
        """Return True if the peer answers within some seconds."""
        password = (self.remote_password or "").encode()
        for pair in tuple(self._nominated.values()):
            request = self.build_request(pair, nominate=False)
            try:
                await pair.protocol.request(request, pair.remote_addr, password, 2)
            except (stun.TransactionError, OSError):
                return False
        return True

    def release(self) -> None:
        """Break the reference cycles of an agent that has been closed for a while."""
        for pair in self._check_list:
            pair.task = None
        self._check_list.clear()
        self._early_checks.clear()


class GuardedProtocol(StunProtocol):
    """Socket of an ICE agent that hands to aioice only what was validated."""

    guard: IceGuard

    def datagram_received(self, data: bytes | str, addr: tuple[Any, ...]) -> None:
        """Receive a datagram; drop it unless it is valid and from an address of the peer."""
        assert isinstance(data, bytes)
        source = (addr[0], addr[1])
        if not data or len(data) > DATAGRAM_BYTES:
            return
        if data[0] < _STUN_BYTES:
            self._receive_stun(data, source)
        elif (
            self.guard.is_source(source)
            and data[0] >= _DTLS_BYTES
            and (data[0] < _MEDIA_BYTES or self.guard.admit_media(data))
        ):
            self.receiver.data_received(data, self.local_candidate.component)

    def _receive_stun(self, data: bytes, source: tuple[str, int]) -> None:
        agent = self.receiver
        try:
            head = check_stun(data)
            if head.kind is StunClass.REQUEST:
                if head.username.startswith(f"{agent.local_username}:".encode()):
                    self._receive_request(stun.parse_message(data), source, len(data))
                return
            transaction: Any = self.transactions.get(head.transaction)
            # A response from another address does not prove that this one receives anything.
            if transaction is not None and source == transaction._Transaction__addr:
                message = stun.parse_message(data)
                if message.check_message_integrity((agent.remote_password or "").encode()):
                    self.guard.answered(source)
                transaction.response_received(message, source)
        except (BadStun, ValueError) as bad:
            logger.debug("discarded %s", bad)

    def _receive_request(self, message: stun.Message, source: tuple[str, int], size: int) -> None:
        """Hand over a request with valid credentials; one without is not answered, since its sender is
        unknown.
        """
        agent = self.receiver
        is_valid = message.check_message_integrity(agent.local_password.encode())
        if is_valid and self.guard.admit_request(source, size):
            agent.request_received(message, source, self)

    def send_stun(self, message: stun.Message, addr: tuple[str, int]) -> None:
        """Send a message, except for one beyond the limits, which counts as lost."""
        data = bytes(message)
        if message.message_class != stun.Class.REQUEST:
            is_admitted = self.guard.admit_response(addr, len(data))
        else:
            # Only checks have credentials of the other side; questions to a STUN server do not.
            is_admitted = "USERNAME" not in message.attributes or self.guard.admit_check(addr, len(data))
        if is_admitted:
            self.transport.sendto(data, addr)


TURN_REQUESTS_PER_SECOND: Final = 20
"""Requests to a TURN server, after a burst of :data:`TURN_REQUESTS`; it determines when they are repeated."""
TURN_REQUESTS: Final = 100
TURN_MESSAGES: Final = 500
"""Messages of a TURN server over TCP in one turn of the event loop."""
TURN_BYTES: Final = DATAGRAM_BYTES + 64
"""Maximum size of a message of a TURN server: a datagram, and what describes it."""


_TURN_HEAD: Final = Struct("!HH")


class _GuardedTurn(turn.TurnClientMixin):
    """Connection to a TURN server, which is the operator's, or one that a robot names for its clients."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._requests = RateLimit(TURN_REQUESTS_PER_SECOND, TURN_REQUESTS)

    def datagram_received(self, data: bytes | str, addr: tuple[str, int]) -> None:
        """Hand over a message of the server, or drop it unless it is valid."""
        assert isinstance(data, bytes)
        try:
            if not data or data[0] >> 6 != 1:  # Not channel data.
                check_stun(data, TURN_METHODS, TURN_BYTES)
            super().datagram_received(data, addr)
        except BadStun as bad:
            logger.debug("discarded %s of a TURN server", bad)

    def send_stun(self, message: stun.Message, addr: tuple[str, int]) -> None:
        """Send a request; one beyond the rate counts as lost."""
        if self._requests.take(monotonic()):
            super().send_stun(message, addr)


class GuardedTurnUdp(_GuardedTurn, turn.TurnClientUdpProtocol):
    """Connection to a TURN server over UDP."""


class GuardedTurnTcp(_GuardedTurn, turn.TurnClientTcpProtocol):
    """Connection to a TURN server over TCP or TLS. aioice copies all that waits for each message."""

    _waiting = b""

    def data_received(self, data: bytes) -> None:
        """Split what has come into messages."""
        self._waiting += data
        at, end, address = 0, len(self._waiting), self.transport.get_extra_info("peername")
        for _ in range(TURN_MESSAGES):
            if at + _TURN_HEAD.size > end:
                break
            kind, size = _TURN_HEAD.unpack_from(self._waiting, at)
            size = (size + 3 & ~3) + (4 if kind >> 14 == 1 else 20)  # Channel data, or STUN.
            if size > TURN_BYTES:
                self.transport.abort()
                return
            if at + size > end:
                break
            self.datagram_received(self._waiting[at : at + size], address)
            at += size
        else:
            self.transport.pause_reading()
            asyncio.get_running_loop().call_soon(self._go_on)
        self._waiting = self._waiting[at:]

    def _go_on(self) -> None:
        if not self.transport.is_closing():
            self.transport.resume_reading()
            self.data_received(b"")


# aioice looks up the classes here when it connects, and offers no way to pass others.
turn.TurnClientUdpProtocol = GuardedTurnUdp  # type: ignore[misc]  # mypy rejects assignments to names of classes
turn.TurnClientTcpProtocol = GuardedTurnTcp  # type: ignore[misc]  # mypy rejects assignments to names of classes


def way(transport: RTCIceTransport) -> str:
    """Return the path that was found, with its kind: ``directly``, ``through a NAT (STUN)`` or ``by a relay
    (TURN)``; empty before there is one.
    """
    pair = next(iter(transport.iceGatherer._connection._nominated.values()), None)
    if pair is None:
        return ""
    local, remote = pair.local_candidate, pair.remote_candidate
    kinds = {local.type, remote.type}
    if "relay" in kinds:
        found = "by a relay (TURN)"
    elif kinds & {"srflx", "prflx"}:
        found = "through a NAT (STUN)"
    else:
        found = "directly"
    host, port = pair.remote_addr
    return f"{found}: {local.type} {local.host}:{local.port} to {remote.type} {host}:{port}"
