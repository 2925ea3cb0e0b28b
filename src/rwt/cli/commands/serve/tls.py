"""`--tls auto`: encrypted listener, and instructions for opening the page on a phone."""

from __future__ import annotations

import io
import sys
from typing import TYPE_CHECKING

from rwt.access.origins import is_loopback_listener
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt_transports.schemes import scheme_of

if TYPE_CHECKING:
    from rwt.server import Server
    from rwt.settings.models import Settings


def encrypted(settings: Settings) -> Settings:
    """Return settings with an encrypted listener, by default on this machine only.

    Raises:
        CommandError: there are listeners, and none is encrypted.
    """
    if "listen" not in settings.model_fields_set:
        return settings.model_copy(update={"listen": ("wss://127.0.0.1:9090",)})
    schemes = map(scheme_of, settings.listen)
    if not any(scheme is not None and scheme.tls for scheme in schemes):
        raise CommandError(
            f"--tls auto: {', '.join(settings.listen)} is not encrypted: expected a URL such as"
            " wss://0.0.0.0:9090",
            exit_code=CALLED_WRONGLY,
        )
    return settings


def for_devices(server: Server) -> str:
    """Return the lines on how other devices open and trust the page, on a terminal with a QR code.

    Empty if the server did not create its certificate.
    """
    url = next((url for url in server.urls if url.startswith("wss://")), None)
    if not server.settings.tls.auto or url is None:
        return ""
    from rwt.composition.certificates import AUTHORITY_PATH
    from rwt.tls.own_certificate import own_certificate

    made = own_certificate(server.settings.tls)
    host = _host_for_devices(url, made.names)
    page = f"https://{host or 'localhost'}:{url.rpartition(':')[2]}"
    lines = [
        f"page: {page}/",
        f"  to have it trusted, install {page}{AUTHORITY_PATH} on the device (a copy of {made.authority})",
        f"  SHA-256 {made.fingerprint}",
    ]
    if host is None:
        lines.append(
            "  no address of this machine is private: name the one that devices use, --set tls.names=ADDRESS"
        )
    elif is_loopback_listener(url):
        lines.append("  only this machine reaches it; for a phone: rwt serve --tls auto wss://0.0.0.0:9090")
    elif sys.stdout.isatty():
        lines.append(qr_code(f"{page}/"))
    return "\n".join(lines)


def _host_for_devices(url: str, names: tuple[str, ...]) -> str | None:
    """Return the host of a URL; for a wildcard address, the first non-loopback address that the certificate
    names; None without one."""
    host = url.removeprefix("wss://").rpartition(":")[0]
    if host not in ("0.0.0.0", "[::]"):
        return host
    from rwt.tls.machine import machine_addresses

    for address in machine_addresses():
        if str(address) in names and not address.is_loopback and (address.version == 4 or host == "[::]"):
            return f"[{address}]" if address.version == 6 else str(address)
    return None


def qr_code(text: str) -> str:
    """Return a text as a QR code (ISO/IEC 18004) of block characters, for terminals of any colours."""
    import segno

    drawn = io.StringIO()
    segno.make(text, micro=False, error="l").terminal(drawn, compact=True)
    return drawn.getvalue().rstrip("\n")
