"""Certificate of a peer, whose handshake also accepts the RSA certificates of GStreamer up to 1.22.

Borrows :class:`aiortc.RTCCertificate`, whose ciphers are for elliptic-curve certificates only. Private names,
and why each is needed:

* ``_create_ssl_context``: the one place where aiortc makes the context whose ciphers can be chosen.
"""

from __future__ import annotations

from typing import Any, Final

from aiortc import RTCCertificate

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
"""aiortc's ciphers, and some for RSA. The fingerprint in the session description authenticates both kinds."""


class AnyCertificate(RTCCertificate):
    """Certificate for handshakes with peers whose certificate is of either kind."""

    def _create_ssl_context(self, srtp_profiles: list[Any]) -> Any:
        context = super()._create_ssl_context(srtp_profiles)
        context.set_cipher_list(CIPHERS)
        return context
