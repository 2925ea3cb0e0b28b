"""Certificate of `tls.auto`: an authority kept for the user, and a server certificate that it signs.

Devices that are to trust the machine install the authority once.
"""

from __future__ import annotations

import datetime
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.access.settings import SettingsError, TlsSettings
from rwt.tls.machine import machine_addresses, machine_names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cryptography import x509


@dataclass(frozen=True, slots=True)
class OwnCertificate:
    """Certificate files of this machine.

    Attributes:
        authority: PEM file with the authority's certificate, to install on devices.
        fingerprint: its SHA-256, as devices show it.
        server: PEM file with the server's key and certificate, readable only by its user.
        names: names and addresses in the server's certificate.
    """

    authority: Path
    fingerprint: str
    server: Path
    names: tuple[str, ...]


def own_certificate(settings: TlsSettings, now: datetime.datetime | None = None) -> OwnCertificate:
    """Return the certificate of `tls.auto`, creating one unless a valid one that names this machine exists.

    Args:
        now: time with time zone; default: the current time.

    Raises:
        SettingsError: the extra is not installed, a name is invalid, or a file cannot be read, is damaged or
            readable by others.
    """
    try:
        import ifaddr  # noqa: F401 - checks that the extra is installed; rwt.tls.machine imports it later

        from rwt.tls import kept
    except ImportError as error:
        raise SettingsError(f"tls.auto: needs {error.name}: pip install 'robot-web-tools[tls]'") from error
    now = now or datetime.datetime.now(datetime.UTC)
    folder = settings.folder or default_folder()
    try:
        kept.make_folder(folder)
        authority = kept.kept_authority(folder, settings.names, now)
        wanted = _names(settings.names, authority.certificate, folder)
        names = kept.kept_server(folder, authority, wanted, now)
    except OSError as error:
        raise SettingsError(f"tls.auto: {error.filename or folder}: {error.strerror}") from error
    from cryptography.hazmat.primitives.hashes import SHA256

    fingerprint = authority.certificate.fingerprint(SHA256()).hex(":").upper()
    return OwnCertificate(folder / kept.AUTHORITY_ALONE, fingerprint, folder / kept.SERVER, names)


def default_folder() -> Path:
    """Return the default folder in the user's state directory (XDG Base Directory Specification)."""
    state = os.environ.get("XDG_STATE_HOME", "")
    return (Path(state) if os.path.isabs(state) else Path.home() / ".local" / "state") / "rwt" / "tls"


def _names(given: Sequence[str], authority: x509.Certificate, folder: Path) -> tuple[str, ...]:
    """Return the names for the server's certificate: permitted names of this machine, and `given`."""
    from rwt.tls.authority import vouches_for

    for name in given:
        if not vouches_for(authority, name):
            raise SettingsError(
                f"tls.names: {name}: the authority in {folder} was made without it and cannot vouch for it;"
                " remove that folder to have another made, which devices have to be given anew"
            )
    own = [*machine_names(), *map(str, machine_addresses())]
    return tuple(dict.fromkeys([*given, *(name for name in own if vouches_for(authority, name))]))
