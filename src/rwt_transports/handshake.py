"""The opening handshake of a WebSocket (RFC 6455 section 4), decided from a request already parsed."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from websockets.datastructures import Headers
from websockets.exceptions import InvalidHeader, InvalidUpgrade, NegotiationError
from websockets.extensions.base import Extension
from websockets.extensions.permessage_deflate import PerMessageDeflate, ServerPerMessageDeflateFactory
from websockets.http11 import Request
from websockets.server import ServerProtocol
from websockets.typing import ExtensionParameter, Subprotocol

from .wires.deflate import Deflate

SUBPROTOCOL = Subprotocol("rwt")
"""What a client offers that wants the server to confirm what is spoken; it may offer others beside it."""

_SMALLEST_WINDOW_BITS = 9

_quiet = logging.getLogger("rwt_transports.handshake")


@dataclass(frozen=True, slots=True)
class HandshakeAnswer:
    """What to answer an upgrade request.

    Attributes:
        status: 101 when the connection may open, else a 4xx.
        head: the whole 101 response, empty for a refusal.
        reason: why it was refused, one line.
        deflate: what was agreed about compression, None for none.
    """

    status: int
    head: bytes = b""
    reason: str = ""
    deflate: Deflate | None = None


def wants_websocket(headers: Iterable[tuple[str, str]]) -> bool:
    """Whether a request asks to become a WebSocket: its ``Upgrade`` header names it (RFC 6455 section
    4.1)."""
    return any(
        name.lower() == "upgrade" and "websocket" in [token.strip().lower() for token in value.split(",")]
        for name, value in headers
    )


def answer_handshake(
    path: str, headers: Iterable[tuple[str, str]], *, deflate: bool = False
) -> HandshakeAnswer:
    """Check the upgrade request and make the answer (RFC 6455 section 4.2).

    Args:
        path: path and query.
        headers: of the request.
        deflate: whether to agree to permessage-deflate where it is offered (RFC 7692 section 5).
    """
    extensions = [_Offers()] if deflate else None
    protocol = ServerProtocol(logger=_quiet, select_subprotocol=_select, extensions=extensions)
    try:
        given = Headers(list(headers))
    except InvalidHeader as error:
        # HTTP lets control characters pass in values; the library does not.
        return HandshakeAnswer(400, reason=_reason(error))
    response = protocol.accept(Request(path, given))
    if response.status_code == 101:
        return HandshakeAnswer(101, response.serialize(), deflate=_agreed(protocol))
    failure = protocol.handshake_exc
    wrong_version = isinstance(failure, InvalidHeader) and failure.name == "Sec-WebSocket-Version"
    # RFC 6455 section 4.4 asks for 426 with the version that is spoken.
    return HandshakeAnswer(426 if wrong_version else response.status_code, reason=_reason(failure))


class _Offers(ServerPerMessageDeflateFactory):
    """What to agree to: see :mod:`rwt_transports.wires.deflate`."""

    def __init__(self) -> None:
        super().__init__(server_no_context_takeover=True)

    def process_request_params(
        self, params: Sequence[ExtensionParameter], accepted_extensions: Sequence[Extension]
    ) -> tuple[list[ExtensionParameter], PerMessageDeflate]:
        """Raises NegotiationError for an offer that cannot be met; the client may have made others."""
        answer, extension = super().process_request_params(params, accepted_extensions)
        if extension.local_max_window_bits < _SMALLEST_WINDOW_BITS:
            raise NegotiationError("zlib cannot compress with a window of 256 bytes")
        return answer, extension


def _agreed(protocol: ServerProtocol) -> Deflate | None:
    for extension in protocol.extensions:
        if isinstance(extension, PerMessageDeflate):
            return Deflate(
                window_bits=extension.local_max_window_bits,
                peer_window_bits=extension.remote_max_window_bits,
                peer_keeps_context=not extension.remote_no_context_takeover,
            )
    return None


def _select(_: ServerProtocol, offered: Sequence[Subprotocol]) -> Subprotocol | None:
    """The subprotocol to speak (RFC 6455 section 4.2.2): ours if it is offered, else none.

    Clients that offer only others get none, and go on or not as they please.
    """
    return SUBPROTOCOL if SUBPROTOCOL in offered else None


def _reason(failure: Exception | None) -> str:
    if isinstance(failure, InvalidUpgrade):
        return "a WebSocket needs the headers `Upgrade: websocket` and `Connection: Upgrade`"
    if isinstance(failure, InvalidHeader):
        return f"the header {failure.name} of a WebSocket handshake is missing or wrong"
    return "this is not a valid WebSocket handshake"
