"""TLS contexts of listeners and of connections to hubs."""

from __future__ import annotations

import ssl
from pathlib import Path

from rwt.access.settings import SettingsError, TlsSettings


def server_tls(settings: TlsSettings) -> ssl.SSLContext | None:
    """Return the context of listeners (TLS 1.2 or later); None if no certificate is configured (CFG-02).

    Raises:
        SettingsError: a file cannot be read, or has invalid content.
    """
    if (files := _files(settings)) is None:
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # With a password argument, a protected key fails here instead of prompting on the terminal.
        context.load_cert_chain(*files, password="")
    except (ssl.SSLError, ValueError) as error:
        raise SettingsError(
            f"tls: {files[0]} and {files[1]}: expected a certificate and the key that"
            " belongs to it, both in PEM, the key without a password"
        ) from error
    return context


def _files(settings: TlsSettings) -> tuple[Path, Path] | None:
    """Return the files of certificate and key, which are one file with `tls.auto`."""
    if settings.auto:
        from rwt.tls.own_certificate import own_certificate  # Slow import, only for `tls.auto`.

        made = own_certificate(settings)
        return made.server, made.server
    if settings.certfile is None or settings.keyfile is None:
        return None
    for key, path in (("certfile", settings.certfile), ("keyfile", settings.keyfile)):
        _check_readable(f"tls.{key}", path)
    return settings.certfile, settings.keyfile


def renew_server_tls(context: ssl.SSLContext, settings: TlsSettings) -> None:
    """Load the certificate again, for new connections; open ones keep theirs.

    Raises:
        SettingsError: as :func:`server_tls`; the context keeps the old certificate.
    """
    if server_tls(settings) is not None and (files := _files(settings)) is not None:
        context.load_cert_chain(*files, password="")


def client_tls(cafile: Path | None) -> ssl.SSLContext | None:
    """Return a context that trusts the authorities in a PEM file; None, for the system's, without a file.

    Raises:
        SettingsError: the file cannot be read, or contains no certificate.
    """
    if cafile is None:
        return None
    _check_readable("dial.cafile", cafile)
    try:
        return ssl.create_default_context(cafile=cafile)
    except ssl.SSLError as error:
        raise SettingsError(f"dial.cafile: {cafile}: expected certificates in PEM") from error


def _check_readable(key: str, path: Path) -> None:
    try:
        path.open("rb").close()
    except OSError as error:
        raise SettingsError(f"{key}: {path}: cannot be read: {error.strerror}") from error
