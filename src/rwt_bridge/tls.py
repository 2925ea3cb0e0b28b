"""The certificate of encrypted listeners, from files."""

from __future__ import annotations

import ssl
from pathlib import Path
from typing import TYPE_CHECKING

from rwt_bridge.settings import SettingsError

if TYPE_CHECKING:
    from rwt_bridge.settings import TlsSettings


def server_tls(settings: TlsSettings) -> ssl.SSLContext | None:
    """What encrypts listeners (TLS 1.2 or later); None where no certificate is configured (CFG-02).

    Raises:
        SettingsError: a file cannot be read, or is not what it should be.
    """
    if settings.certfile is None or settings.keyfile is None:
        return None
    for key, path in (("certfile", settings.certfile), ("keyfile", settings.keyfile)):
        _check_readable(f"tls.{key}", path)
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # A password is given so that a key which needs one fails here, instead of asking at a terminal.
        context.load_cert_chain(settings.certfile, settings.keyfile, password="")
    except (ssl.SSLError, ValueError) as error:
        raise SettingsError(
            f"tls: {settings.certfile} and {settings.keyfile}: expected a certificate and the key that"
            " belongs to it, both in PEM, the key without a password"
        ) from error
    return context


def _check_readable(key: str, path: Path) -> None:
    try:
        path.open("rb").close()
    except OSError as error:
        raise SettingsError(f"{key}: {path}: cannot be read: {error.strerror}") from error
