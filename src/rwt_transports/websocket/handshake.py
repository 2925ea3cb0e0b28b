"""Server side of a WebSocket's opening handshake (RFC 6455 section 4), for a parsed request."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from websockets.datastructures import Headers
from websockets.exceptions import InvalidHeader, InvalidUpgrade
from websockets.http11 import Request
from websockets.server import ServerProtocol
from websockets.typing import Subprotocol

from rwt_transports.limits import Deflate
from rwt_transports.websocket.extensions import DeflateTerms, agreed_terms, extension_factories

SUBPROTOCOL = Subprotocol("rwt")
"""Subprotocol that clients may offer for confirmation of the protocol."""

_quiet = logging.getLogger("rwt_transports.websocket.handshake")


@dataclass(frozen=True, slots=True)
class HandshakeAnswer:
    """Answer to an upgrade request.

    Attributes:
        status: 101 when the connection may open, else a 4xx.
        head: whole 101 response; empty for a refusal.
        reason: reason of a refusal, one line.
        deflate: agreed parameters of compression; None without compression.
        subprotocol: agreed subprotocol; empty if none.
    """

    status: int
    head: bytes = b""
    reason: str = ""
    deflate: DeflateTerms | None = None
    subprotocol: str = ""


def wants_websocket(headers: Iterable[tuple[str, str]]) -> bool:
    """Return True if a request's ``Upgrade`` header names WebSocket (RFC 6455 section 4.1)."""
    return any(
        name.lower() == "upgrade" and "websocket" in [token.strip().lower() for token in value.split(",")]
        for name, value in headers
    )


def answer_handshake(
    path: str,
    headers: Iterable[tuple[str, str]],
    deflate: Deflate = Deflate.OFF,
    subprotocols: Collection[str] = (),
) -> HandshakeAnswer:
    """Check an upgrade request and return the response (RFC 6455 section 4.2)."""

    def select(_: ServerProtocol, offered: Sequence[Subprotocol]) -> Subprotocol | None:
        chosen = choose_subprotocol(offered, subprotocols)
        return None if chosen is None else Subprotocol(chosen)

    extensions = extension_factories(deflate)
    protocol = ServerProtocol(logger=_quiet, select_subprotocol=select, extensions=extensions)
    try:
        given = Headers(list(headers))
    except InvalidHeader as error:
        # HTTP permits control characters in values; the library does not.
        return HandshakeAnswer(400, reason=_reason(error))
    response = protocol.accept(Request(path, given))
    if response.status_code == 101:
        return HandshakeAnswer(
            101,
            response.serialize(),
            deflate=agreed_terms(protocol.extensions),
            subprotocol=protocol.subprotocol or "",
        )
    failure = protocol.handshake_exc
    wrong_version = isinstance(failure, InvalidHeader) and failure.name == "Sec-WebSocket-Version"
    # RFC 6455 section 4.4 requires 426 with the supported version.
    return HandshakeAnswer(426 if wrong_version else response.status_code, reason=_reason(failure))


def choose_subprotocol(offered: Iterable[str], spoken: Collection[str]) -> str | None:
    """Return the first offered subprotocol that is supported (RFC 6455 section 4.2.2); None without one."""
    return next((each for each in offered if each == SUBPROTOCOL or each in spoken), None)


def _reason(failure: Exception | None) -> str:
    if isinstance(failure, InvalidUpgrade):
        return "a WebSocket needs the headers `Upgrade: websocket` and `Connection: Upgrade`"
    if isinstance(failure, InvalidHeader):
        return f"the header {failure.name} of a WebSocket handshake is missing or wrong"
    return "this is not a valid WebSocket handshake"
