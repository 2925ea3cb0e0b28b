"""WebSocket extensions: permessage-deflate (RFC 7692)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from websockets.extensions import Extension, ServerExtensionFactory
from websockets.extensions.permessage_deflate import PerMessageDeflate, ServerPerMessageDeflateFactory

from rwt_transports.limits import Deflate

WINDOW_BITS: Final = 12
"""Window of this side's compression with context: 4 KiB, enough for similar messages."""


@dataclass(frozen=True, slots=True)
class DeflateTerms:
    """Agreed parameters (RFC 7692 section 7.1).

    Attributes:
        keeps_context: True if this side compresses in the context of earlier messages.
        peer_keeps_context: the same of the other side.
        window_bits: size of this side's window in bits.
    """

    keeps_context: bool
    peer_keeps_context: bool
    window_bits: int


def extension_factories(deflate: Deflate) -> Sequence[ServerExtensionFactory] | None:
    """Return the extensions that the handshake may accept."""
    if deflate is Deflate.OFF:
        return None
    if deflate is Deflate.SHARED:
        # Without takeover, the compressed bytes of a message do not depend on the connection.
        return [ServerPerMessageDeflateFactory(server_no_context_takeover=True)]
    return [ServerPerMessageDeflateFactory(server_max_window_bits=WINDOW_BITS)]


def agreed_terms(extensions: Sequence[Extension]) -> DeflateTerms | None:
    """Return the parameters that the handshake accepted."""
    for extension in extensions:
        if isinstance(extension, PerMessageDeflate):
            return DeflateTerms(
                keeps_context=not extension.local_no_context_takeover,
                peer_keeps_context=not extension.remote_no_context_takeover,
                window_bits=extension.local_max_window_bits,
            )
    return None
