"""ICE agent (RFC 8445): aioice's, with limits, further candidates and quick detection of a lost peer.

aioice answers requests without credentials, takes what it cannot parse for data, queues data of any address
without limit, and notices a lost peer after half a minute. It offers no public way to change that, so this
module uses its private names. aioice is pinned below 0.14, and
`tests/rwt/media/webrtc/test_private_names.py` checks them.
"""

from __future__ import annotations

import asyncio
import logging
import random
from typing import TYPE_CHECKING, Any, Final, cast

from aioice import Candidate, Connection, stun
from aioice.ice import StunProtocol

from rwt_transports.webrtc.ice_guard import DATAGRAM_BYTES, EARLY_DATAGRAMS, WAITING_DATAGRAMS, Reach
from rwt_transports.webrtc.stun_messages import BadStun, StunClass, check_stun

if TYPE_CHECKING:
    from aiortc import RTCIceTransport

    from rwt_transports.webrtc.ice_guard import IceGuard

logger = logging.getLogger("rwt_transports.webrtc")

CONSENT_SECONDS: Final = 0.7
"""Interval of consent checks (RFC 7675) in seconds."""
CONSENT_EXPIRES_SECONDS: Final = 3.6
"""Without an answer for so long it counts as gone. RFC 7675 allows 30 s, in which a robot drives far."""
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
        is_here = addresses and self.guard.reach is Reach.LOOPBACK
        found = await super().get_component_candidates(
            component, [*addresses, LOOPBACK] if is_here else addresses, timeout or GATHER_SECONDS
        )
        for protocol in self._protocols:
            protocol.__class__ = GuardedProtocol  # aioice makes them.
            cast("GuardedProtocol", protocol).guard = self.guard
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
            while now() - answered < CONSENT_EXPIRES_SECONDS or unanswered < CONSENT_ASKED:
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
    """Socket of an ICE agent that hands to aioice only what was validated.

    Attributes:
        guard: limits of the agent.
    """

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
                    self._receive_request(stun.parse_message(data), source)
            elif (transaction := self.transactions.get(head.transaction)) is not None:
                message = stun.parse_message(data)
                if message.check_message_integrity((agent.remote_password or "").encode()):
                    self.guard.answered(source)
                transaction.response_received(message, source)
        except (BadStun, ValueError) as bad:
            logger.debug("discarded %s", bad)

    def _receive_request(self, message: stun.Message, source: tuple[str, int]) -> None:
        """Hand over a request with valid credentials; one without is not answered, since its sender is
        unknown.
        """
        agent = self.receiver
        if message.check_message_integrity(agent.local_password.encode()) and self.guard.admit_request(
            source
        ):
            agent.request_received(message, source, self)

    def send_stun(self, message: stun.Message, addr: tuple[str, int]) -> None:
        """Send a message, except for a check beyond the limits, which counts as lost."""
        # Only checks have credentials of the other side; questions to a STUN server do not.
        is_check = message.message_class == stun.Class.REQUEST and "USERNAME" in message.attributes
        if not is_check or self.guard.admit_check(addr):
            super().send_stun(message, addr)


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
