"""End of a certificate's validity: a warning in time, and a metric."""

from __future__ import annotations

import datetime
import logging
import ssl
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Final

from rwt.access.settings import SettingsError, TlsSettings
from rwt_transports.http.routes import HttpExtension, MetricFamily, Reader

logger = logging.getLogger(__name__)

WARNING_DAYS: Final = 30

_BEGIN: Final = "-----BEGIN CERTIFICATE-----"
_END: Final = "-----END CERTIFICATE-----"
_DAY_SECONDS: Final = 86_400
_UTC_TIME: Final = 0x17
_VERSION: Final = 0xA0


def expiry_of(path: Path) -> float:
    """Return when the first certificate of a PEM file expires, in seconds since 1970.

    Raises:
        SettingsError: the file cannot be read, or its first certificate is invalid.
    """
    try:
        text = path.read_text(encoding="utf-8")
        der = ssl.PEM_cert_to_DER_cert(text[text.index(_BEGIN) : text.index(_END)] + _END)
        # Certificate, its signed part, and in it the validity behind version, number, algorithm and issuer
        # (RFC 5280 section 4.1).
        signed = _members(_members(der)[0][1])[0][1]
        fields = [value for tag, value in _members(signed) if tag != _VERSION]
        tag, value = _members(fields[3])[1]
        form = "%y%m%d%H%M%SZ" if tag == _UTC_TIME else "%Y%m%d%H%M%SZ"
        end = datetime.datetime.strptime(value.decode("ascii"), form)
    except OSError as error:
        raise SettingsError(f"`tls.certfile`: {path}: cannot be read: {error.strerror}") from error
    except (ValueError, IndexError) as error:
        raise SettingsError(f"`tls.certfile`: {path}: expected a certificate in PEM") from error
    return end.replace(tzinfo=datetime.UTC).timestamp()


def _members(data: bytes) -> list[tuple[int, bytes]]:
    """Return tag and content of each element of DER (ITU-T X.690)."""
    found, at = [], 0
    while at < len(data):
        tag, size, at = data[at], data[at + 1], at + 2
        if size & 0x80:
            count = size & 0x7F
            size, at = int.from_bytes(data[at : at + count], "big"), at + count
        found.append((tag, data[at : at + size]))
        at += size
    return found


def expiry_warning(settings: TlsSettings) -> str:
    """Return a warning about a certificate that has expired or is about to; empty if there is none.

    Raises:
        SettingsError: as :func:`expiry_of`.
    """
    if settings.certfile is None:
        return ""
    left = expiry_of(settings.certfile) - time.time()
    if left > WARNING_DAYS * _DAY_SECONDS:
        return ""
    when = f"expires in {left / _DAY_SECONDS:.0f} days" if left > 0 else "has expired: clients refuse it"
    return f"`tls.certfile`: {settings.certfile} {when}; renew it, and reload the server"


def warn_of_expiry(settings: TlsSettings) -> None:
    """Log :func:`expiry_warning`."""
    if warning := expiry_warning(settings):
        logger.warning("%s", warning)


def expiry_metrics(settings: TlsSettings) -> HttpExtension[Reader]:
    """Return the metric of a certificate's expiry; none without a certificate of the operator."""
    certfile = settings.certfile
    return HttpExtension() if certfile is None else HttpExtension(metrics=partial(_metrics, certfile))


def _metrics(certfile: Path) -> Iterable[MetricFamily]:
    try:
        expiry = expiry_of(certfile)
    except SettingsError:
        return ()  # The file is being replaced, or a reload will reject it; the loaded one is unknown.
    help_ = "When the certificate of the server expires, Unix time."
    return (MetricFamily("rwt_certificate_expires_seconds", "gauge", help_, [({}, expiry)]),)
