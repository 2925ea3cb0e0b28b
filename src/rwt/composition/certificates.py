"""Certificate created by the server: renewal while it runs, and a page with its authority for devices."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from rwt.access.settings import SettingsError
from rwt.tls.tls import renew_server_tls
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route

if TYPE_CHECKING:
    from ssl import SSLContext

    from rwt.access.settings import TlsSettings
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer

logger = logging.getLogger(__name__)

AUTHORITY_PATH: Final = "/tls/authority.crt"
_PERIOD: Final = 3600.0
"""Interval of checks in seconds; they also cover the machine's addresses, and changes of its clock."""


class CertificateRenewal:
    """Hourly check that replaces a certificate which expires or no longer names the machine."""

    def __init__(self, clock: Clock, context: SSLContext, settings: TlsSettings) -> None:
        self._clock = clock
        self._context = context
        self._settings = settings
        self._timer: Timer = clock.call_later(_PERIOD, self._look)

    def _look(self) -> None:
        try:
            renew_server_tls(self._context, self._settings)
        except SettingsError as error:
            logger.error("the certificate stays as it was: %s", error)
        self._timer = self._clock.call_later(_PERIOD, self._look)

    def close(self) -> None:
        """Stop checking."""
        self._timer.cancel()


def authority_page(settings: TlsSettings) -> HttpExtension:
    """Page with the authority's certificate, which devices install. It is public; the key is not in it."""

    def page(request: HttpRequest, reader: Reader) -> HttpResponse:
        from rwt.tls.own_certificate import own_certificate

        return HttpResponse(
            own_certificate(settings).authority.read_bytes(),
            content_type="application/x-x509-ca-cert",
            headers={
                "Cache-Control": "no-store",
                "Content-Disposition": 'attachment; filename="robot-authority.crt"',
            },
        )

    return HttpExtension((Route(AUTHORITY_PATH, page, Audience.ANYBODY),))
