"""Connectivity between peers (ICE, RFC 8445): servers, addresses and consent."""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final
from urllib.parse import quote

from aioice import Candidate, Connection
from aioice.stun import TransactionError
from aiortc import RTCConfiguration, RTCIceServer
from aiortc.rtcconfiguration import RTCIceTransportPolicy
from aiortc.rtcicetransport import parse_stun_turn_uri

from rwt_transports.errors import TransportError
from rwt_transports.webrtc.aiortc_internals import configure_ice, nominated_pairs
from rwt_transports.webrtc.ice_guard import Reach

if TYPE_CHECKING:
    from aiortc import RTCIceTransport

    from rwt_transports.webrtc.aiortc_internals import Gather
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


class BadIceServer(TransportError):
    """The URL of a STUN or TURN server is not usable."""


@dataclass(frozen=True, slots=True)
class IceServer:
    """STUN or TURN server, which helps to find a path.

    Attributes:
        url: ``stun:HOST``, ``turn:HOST:PORT?transport=udp`` or ``turns:HOST`` (RFC 7064, RFC 7065).
        username: for TURN.
        credential: its password.
    """

    url: str
    username: str = ""
    credential: str = ""

    @property
    def link(self) -> str:
        """As the ``Link`` header of an answer names it (RFC 9725 section 4.6)."""
        parts = [f'<{quote(self.url, safe=":/?=&@[]%~+,;")}>; rel="ice-server"']
        if self.username:
            parts += [f'username="{_quoted(self.username)}"', f'credential="{_quoted(self.credential)}"']
            parts.append('credential-type="password"')
        return "; ".join(parts)

    @property
    def dictionary(self) -> dict[str, str]:
        """As an ``RTCIceServer`` of the W3C's, which is what a page's peer connection takes."""
        found = {"urls": self.url}
        if self.username:
            found |= {"username": self.username, "credential": self.credential}
        return found


def _quoted(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def check_ice_url(url: str) -> str:
    """Check and return the URL of a STUN or TURN server.

    Raises:
        BadIceServer: it is none, or aiortc cannot use it.
    """
    try:
        found = parse_stun_turn_uri(url)
    except ValueError:
        raise BadIceServer(f"{url!r} is no STUN or TURN server; for example stun:stun.example.org") from None
    if found["scheme"] == "stuns":
        raise BadIceServer(f"{url!r}: STUN over TLS cannot be used here; use stun:{url[6:]}")
    return url


def configuration(servers: tuple[IceServer, ...], *, relay_only: bool = False) -> RTCConfiguration:
    """Return aiortc's configuration. Without servers none is used; aiortc's default would be Google's."""
    return RTCConfiguration(
        iceServers=[
            RTCIceServer(each.url, each.username or None, each.credential or None) for each in servers
        ],
        iceTransportPolicy=RTCIceTransportPolicy.RELAY if relay_only else RTCIceTransportPolicy.ALL,
    )


def prepare(transport: RTCIceTransport, guard: IceGuard) -> None:
    """Make an ICE transport detect a lost peer quickly, and limit what it receives and sends.

    Args:
        transport: one that has not gathered candidates yet.
        guard: limits of the agent; the loopback address is a candidate if the other side may be on this
            machine.
    """
    more = (LOOPBACK,) if guard.reach is Reach.LOOPBACK else ()
    configure_ice(transport, _query_consent, lambda gather: partial(_gather, gather, more), guard)


async def _gather(
    gather: Gather,
    more: tuple[str, ...],
    component: int,
    addresses: list[str],
    timeout: int = 0,  # noqa: ASYNC109 - the signature is aioice's
) -> list[Candidate]:
    """Gather further candidates such as loopback, which aioice omits, without its timeout of five seconds."""
    # No addresses: only relays are used.
    return await gather(component, [*addresses, *more] if addresses else [], timeout or GATHER_SECONDS)


async def _query_consent(connection: Connection) -> None:
    """Ask the peer repeatedly whether it still consents to receive, until it does not answer (RFC 7675)."""
    now = asyncio.get_running_loop().time
    asked: dict[asyncio.Task[bool], None] = {}
    answered, unanswered = now(), 0
    try:
        while True:
            await asyncio.sleep(CONSENT_SECONDS * (0.8 + 0.4 * random.random()))
            if any(task.done() and task.result() for task in asked):
                answered, unanswered = now(), 0
            elif now() - answered >= CONSENT_EXPIRES_SECONDS and unanswered >= CONSENT_ASKED:
                logger.info("a peer does not answer any more, counted as gone")
                return
            asked = {task: None for task in asked if not task.done()}
            unanswered += 1
            asked[asyncio.create_task(_ask(connection))] = None
    finally:
        for task in asked:
            task.cancel()


async def _ask(connection: Connection) -> bool:
    """Return True if the peer answers within some seconds."""
    password = (connection.remote_password or "").encode()
    for pair in nominated_pairs(connection):
        request = connection.build_request(pair, nominate=False)
        try:
            await pair.protocol.request(request, pair.remote_addr, password, 2)
        except (TransactionError, OSError):
            return False
    return True


def describe(transport: RTCIceTransport) -> Mapping[str, str]:
    """Return the path that was found, for logs: the two candidates."""
    pair = next(iter(nominated_pairs(transport)), None)
    if pair is None:
        return {}
    return {
        "local": f"{pair.local_candidate.type} {pair.local_candidate.host}:{pair.local_candidate.port}",
        "remote": f"{pair.remote_candidate.type} {pair.remote_addr[0]}:{pair.remote_addr[1]}",
    }


def way(transport: RTCIceTransport) -> str:
    """Return the kind of path: ``directly``, ``through a NAT (STUN)`` or ``by a relay (TURN)``; empty before
    there is one.
    """
    path = describe(transport)
    if not path:
        return ""
    kinds = {end.partition(" ")[0] for end in path.values()}
    if "relay" in kinds:
        found = "by a relay (TURN)"
    elif kinds & {"srflx", "prflx"}:
        found = "through a NAT (STUN)"
    else:
        found = "directly"
    return f"{found}: {path['local']} to {path['remote']}"


def kinds_of(description: str) -> str:
    """Return the kinds of candidates of a session description, for errors."""
    found = [line.split() for line in description.splitlines() if line.startswith("a=candidate:")]
    named = sorted({f"{words[7]} {words[4]}" for words in found if len(words) > 7})
    return ", ".join(named) or "none"
