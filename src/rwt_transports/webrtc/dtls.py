"""The handshake that encrypts (DTLS, RFC 8827): which kinds of certificates the other side may have."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from aiortc import RTCDtlsTransport

CIPHERS: Final = b":".join(
    (
        b"ECDHE-ECDSA-AES128-GCM-SHA256",
        b"ECDHE-ECDSA-CHACHA20-POLY1305",
        b"ECDHE-ECDSA-AES128-SHA",
        b"ECDHE-ECDSA-AES256-SHA",
        b"ECDHE-RSA-AES128-GCM-SHA256",
        b"ECDHE-RSA-CHACHA20-POLY1305",
    )
)
"""Those of aiortc, which are for certificates of elliptic curves alone, and after them some for RSA, which
GStreamer up to 1.22 has. Whose certificate it is, its fingerprint in the description says, either way."""


def accept_rsa(transport: RTCDtlsTransport) -> None:
    """Let the other side have a certificate of RSA.

    Args:
        transport: one whose handshake has not begun.
    """
    certificate = transport._RTCDtlsTransport__local_certificate  # type: ignore[attr-defined] # aiortc offers no way to configure it
    if not isinstance(certificate._create_ssl_context, partial):
        certificate._create_ssl_context = partial(_with_rsa, certificate._create_ssl_context)


def _with_rsa(create: Callable[[list[Any]], Any], srtp_profiles: list[Any]) -> Any:
    """What `create` makes, an OpenSSL context, with more ciphers."""
    context = create(srtp_profiles)
    context.set_cipher_list(CIPHERS)
    return context
