"""STUN and TURN servers: their URLs, parsers of server lists, and probes (asyncio only)."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote

from aioice import stun, turn
from aiortc import RTCConfiguration, RTCIceServer
from aiortc.rtcconfiguration import RTCIceTransportPolicy
from aiortc.rtcicetransport import parse_stun_turn_uri

import rwt_webrtc.upstream.turn_clients  # noqa: F401 - the import replaces aioice's classes for TURN
from rwt_transports.errors import TransportError
from rwt_webrtc.packets.stun import BadStun, check_stun

MOST_SERVERS: Final = 8
SECONDS: Final = 3.0
"""Timeout of a server in seconds."""
ASKED_EVERY: Final = 0.5
"""Interval of requests in seconds: a datagram may be lost."""


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
        """Value of a ``Link`` header that names the server (RFC 9725 section 4.6)."""
        parts = [f'<{quote(self.url, safe=":/?=&@[]%~+,;")}>; rel="ice-server"']
        if self.username:
            parts += [f'username="{_quoted(self.username)}"', f'credential="{_quoted(self.credential)}"']
            parts.append('credential-type="password"')
        return "; ".join(parts)

    @property
    def dictionary(self) -> dict[str, str]:
        """JSON form of the server, an ``RTCIceServer`` of the W3C's for pages."""
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
    """Return aiortc's configuration. An empty tuple means no servers; aiortc's default is Google's."""
    return RTCConfiguration(
        iceServers=[
            RTCIceServer(each.url, each.username or None, each.credential or None) for each in servers
        ],
        iceTransportPolicy=RTCIceTransportPolicy.RELAY if relay_only else RTCIceTransportPolicy.ALL,
    )


@dataclass(frozen=True, slots=True)
class Probe:
    """Result of a request to a STUN or TURN server.

    Attributes:
        text: address that the server reported, or the reason of the failure.
        refused: True if the server answered with an error, for example about the credential.
    """

    url: str
    works: bool
    text: str
    refused: bool = False


def read_ice_servers(listed: Sequence[Mapping[str, object]]) -> tuple[IceServer, ...]:
    """Parse a list of the W3C's ``RTCIceServer``.

    Raises:
        BadIceServer: the list cannot be used; says why.
    """
    found: list[IceServer] = []
    for each in listed:
        urls, username, credential = each.get("urls"), each.get("username", ""), each.get("credential", "")
        several = urls if isinstance(urls, list | tuple) else [urls]
        if not isinstance(username, str) or not isinstance(credential, str):
            raise BadIceServer(f"`username` and `credential` of {urls!r:.80} are no texts")
        for url in several:
            if not isinstance(url, str):
                raise BadIceServer('a STUN or TURN server is like {"urls": "stun:stun.example.org"}')
            found.append(IceServer(check_ice_url(url), username, credential))
    if len(found) > MOST_SERVERS:
        raise BadIceServer(f"{len(found)} STUN and TURN servers; the limit is {MOST_SERVERS}")
    return tuple(found)


def read_configuration(text: bytes) -> tuple[IceServer, ...]:
    """Parse a JSON ``RTCConfiguration``, as returned by ``GET /webrtc``.

    Raises:
        BadIceServer: it is none, or its servers cannot be used.
    """
    try:
        body = json.loads(text)
    except (ValueError, RecursionError):
        body = None
    listed = body.get("iceServers", []) if isinstance(body, dict) else None
    if not isinstance(listed, list) or not all(isinstance(each, dict) for each in listed):
        raise BadIceServer('expected STUN and TURN servers as JSON like {"iceServers": [{"urls": "stun:…"}]}')
    return read_ice_servers(listed)


async def probe(server: IceServer) -> Probe:
    """Request the address that a STUN server sees, or a relay of a TURN server."""
    parsed = parse_stun_turn_uri(server.url)
    host, port = str(parsed["host"]), int(parsed["port"])
    try:
        async with asyncio.timeout(SECONDS):
            if parsed["scheme"] == "stun":
                return Probe(server.url, True, f"it sees this machine as {await _seen_by(host, port)}")
            is_tls, transport = parsed["scheme"] == "turns", str(parsed["transport"])
            relay = await _relay_of(host, port, server, transport, is_tls=is_tls)
            return Probe(server.url, True, f"it relays by {relay}")
    except socket.gaierror as error:
        return Probe(server.url, False, f"its name is not known here: {error.strerror or error}")
    except TimeoutError:
        return Probe(server.url, False, f"it does not answer within {SECONDS:g} s")
    except stun.TransactionFailed as refused:
        return Probe(server.url, False, _refusal(refused, server), refused=True)
    except (OSError, stun.TransactionError) as error:
        return Probe(server.url, False, f"it cannot be reached: {error or type(error).__name__}")


def _refusal(refused: stun.TransactionFailed, server: IceServer) -> str:
    code, reason = refused.response.attributes.get("ERROR-CODE", (0, "without a reason"))
    if code == 401:
        who = f"the credential of {server.username!r}" if server.username else "clients without a credential"
        return f"it refuses {who} (401 {reason})"
    return f"it refuses ({code} {reason})"


class _Answers(asyncio.DatagramProtocol):
    """Responses to a socket that queries one server."""

    def __init__(self) -> None:
        self.first: asyncio.Future[tuple[str, int]] = asyncio.get_running_loop().create_future()

    def datagram_received(self, data: bytes, addr: object) -> None:
        try:
            check_stun(data)
            seen = stun.parse_message(data).attributes.get("XOR-MAPPED-ADDRESS")
        except (BadStun, ValueError):
            return  # Not an answer.
        if seen is not None and not self.first.done():
            self.first.set_result((str(seen[0]), int(seen[1])))

    def error_received(self, exc: Exception) -> None:
        if not self.first.done():
            self.first.set_exception(exc)


async def _seen_by(host: str, port: int) -> str:
    loop = asyncio.get_running_loop()
    transport, answers = await loop.create_datagram_endpoint(_Answers, remote_addr=(host, port))
    question = stun.Message(message_method=stun.Method.BINDING, message_class=stun.Class.REQUEST)
    try:
        while not answers.first.done():
            transport.sendto(bytes(question))
            await asyncio.wait({answers.first}, timeout=ASKED_EVERY)
        seen = await answers.first
    finally:
        transport.close()
    return f"{seen[0]}:{seen[1]}"


async def _relay_of(host: str, port: int, server: IceServer, transport: str, *, is_tls: bool) -> str:
    relay, _ = await turn.create_turn_endpoint(
        asyncio.DatagramProtocol,
        (host, port),
        server.username or None,
        server.credential or None,
        ssl=is_tls or None,
        transport=transport,
    )
    try:
        address = relay.get_extra_info("sockname")
    finally:
        relay.close()
    return f"{address[0]}:{address[1]}"
