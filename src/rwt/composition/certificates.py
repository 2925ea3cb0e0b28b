"""Certificate created by the server: renewal while it runs, and a page with its authority for devices."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from rwt.access.settings import SettingsError, TlsSettings
from rwt.observability.supervision import Periodic
from rwt.tls.tls import renew_server_tls
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route

if TYPE_CHECKING:
    from ssl import SSLContext

    from rwt_graph.clock import Clock

logger = logging.getLogger(__name__)

AUTHORITY_PATH: Final = "/tls/authority.crt"
_PERIOD: Final = 3600.0
"""Interval of checks in seconds; they also cover the machine's addresses, and changes of its clock."""


def renewal(clock: Clock, context: SSLContext, settings: TlsSettings) -> Periodic:
    """Check hourly, and replace a certificate which expires or no longer names the machine."""

    def renew() -> None:
        try:
            renew_server_tls(context, settings)
        except SettingsError as error:
            # The old one is better than none, and the next check tries again.
            logger.error("the certificate stays as it was: %s", error)

    return Periodic(clock, _PERIOD, renew)


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
