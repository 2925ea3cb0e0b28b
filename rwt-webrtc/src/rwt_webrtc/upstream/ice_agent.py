"""ICE agent (RFC 8445) with limits, further candidates and quick detection of a lost peer.

Borrows :class:`aioice.Connection`, which queues data of any address without limit and notices a lost peer
after half a minute, and :class:`aiortc.RTCIceGatherer`, which makes one itself. Private names, and why each
is needed:

* ``RTCIceGatherer._connection``: the agent, which the gatherer uses and a transport takes.
* ``_transport_policy``: copy the policy; a relayed candidate hides the related address.
* ``_protocols``: the sockets, which aioice pairs with candidates of the other side.
* ``_nominated``: the chosen pairs, for consent checks, for the limit of the queue and for :attr:`way`.
* ``_queue``: received datagrams, to limit them.
* ``_query_consent_task``: the running check, for which closing would wait.
* ``_check_list``, ``_early_checks``: pairs and requests that refer to the agent.
"""

from __future__ import annotations

import asyncio
import logging
import random
import socket
from collections.abc import Coroutine, Sequence
from typing import Any, Final

from aioice import Candidate, Connection, TransportPolicy, stun, turn
from aioice.candidate import candidate_foundation, candidate_priority
from aioice.ice import StunProtocol, relayed_candidate, server_reflexive_candidate
from aiortc import RTCConfiguration, RTCIceGatherer, RTCIceParameters

import rwt_webrtc.upstream.turn_clients  # noqa: F401 - the import replaces aioice's classes for TURN
from rwt_webrtc.packets.ice_guard import (
    EARLY_DATAGRAMS,
    WAITING_DATAGRAMS,
    IceGuard,
    Reach,
    is_unicast,
)
from rwt_webrtc.upstream.ice_socket import GuardedSocket

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


class GuardedGatherer(RTCIceGatherer):
    """Gatherer of candidates.

    Args:
        parameters: credentials of this side; None to choose some.

    Attributes:
        agent: the ICE agent.
    """

    def __init__(
        self, configuration: RTCConfiguration, guard: IceGuard, parameters: RTCIceParameters | None
    ) -> None:
        chosen = parameters or RTCIceParameters()
        super().__init__(
            configuration.iceServers,
            configuration.iceTransportPolicy,
            chosen.usernameFragment,
            chosen.password,
        )
        self._connection = self.agent = GuardedAgent(self._connection, guard)


class GuardedAgent(Connection):
    """ICE agent of a peer.

    Args:
        plain: agent with the same settings, which is not used.
        guard: limits of the agent; the loopback address, which aioice omits, is a candidate if the other side
            may be on this machine.
    """

    def __init__(self, plain: Connection, guard: IceGuard) -> None:
        super().__init__(
            ice_controlling=plain.ice_controlling,
            stun_server=plain.stun_server,
            turn_server=plain.turn_server,
            turn_username=plain.turn_username,
            turn_password=plain.turn_password,
            turn_ssl=plain.turn_ssl,
            turn_transport=plain.turn_transport,
            transport_policy=plain._transport_policy,
            local_username=plain.local_username,
            local_password=plain.local_password,
        )
        self._guard = guard

    async def get_component_candidates(
        self,
        component: int,
        addresses: list[str],
        timeout: int = GATHER_SECONDS,  # noqa: ASYNC109 - the signature is aioice's
    ) -> list[Candidate]:
        """Gather candidates on addresses; none if only relays are used."""
        if addresses and self._guard.reach is Reach.LOOPBACK:
            addresses = [*addresses, LOOPBACK]
        sockets = [each for address in addresses if (each := await self._bind(component, address))]
        asked: list[Coroutine[Any, Any, tuple[Candidate, StunProtocol | None]]] = []
        if self.stun_server is not None:
            ipv4 = [each for each in sockets if ":" not in each.local_candidate.host]
            asked += [server_reflexive_candidate(each, self.stun_server) for each in ipv4]
        if self.turn_server is not None:
            asked.append(self._relayed(component, self.turn_server))
        return [each.local_candidate for each in sockets] + await self._answers(asked, timeout)

    async def _bind(self, component: int, address: str) -> GuardedSocket | None:
        """Return a socket at an address, with its candidate; None if the address is not usable."""
        loop = asyncio.get_running_loop()
        try:
            transport, protocol = await loop.create_datagram_endpoint(self._socket, local_addr=(address, 0))
        except OSError as error:
            logger.debug("no candidate at %s: %s", address, error)
            return None
        transport.get_extra_info("socket").setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVBUF, turn.UDP_SOCKET_BUFFER_SIZE
        )
        host, port = transport.get_extra_info("sockname")[:2]
        protocol.local_candidate = Candidate(
            foundation=candidate_foundation("host", "udp", host),
            component=component,
            transport="udp",
            priority=candidate_priority(component, "host"),
            host=host,
            port=port,
            type="host",
        )
        # At once, so that closing also closes it if gathering is cancelled.
        self._protocols.append(protocol)
        return protocol

    def _socket(self) -> GuardedSocket:
        return GuardedSocket(self, self._guard)

    def _relayed(
        self, component: int, server: tuple[str, int]
    ) -> Coroutine[Any, Any, tuple[Candidate, StunProtocol]]:
        return relayed_candidate(
            component=component,
            hide_related_address=self._transport_policy == TransportPolicy.RELAY,
            protocol_factory=self._socket,
            turn_server=server,
            turn_username=self.turn_username,
            turn_password=self.turn_password,
            turn_ssl=self.turn_ssl,
            turn_transport=self.turn_transport,
        )

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
            while now() - answered < self._guard.consent_seconds or unanswered < CONSENT_ASKED:
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

    @property
    def way(self) -> str:
        """Path that was found, with its kind: ``directly``, ``through a NAT (STUN)`` or ``by a relay
        (TURN)``; empty before there is one.
        """
        pair = next(iter(self._nominated.values()), None)
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
