"""The machine's own certificate: a small authority, kept for its user, and what that vouches for.

Devices that are to trust the machine are given the authority once.
"""

from __future__ import annotations

import datetime
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.access.settings import SettingsError
from rwt.tls.machine import machine_addresses, machine_names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cryptography import x509

    from rwt.access.settings import TlsSettings


@dataclass(frozen=True, slots=True)
class OwnCertificate:
    """What a machine shows of itself.

    Attributes:
        authority: PEM file with the certificate that devices are given to trust.
        fingerprint: its SHA-256, as devices show it.
        server: PEM file with the key and certificate of the server, for its user alone.
        names: names and addresses that it vouches for.
    """

    authority: Path
    fingerprint: str
    server: Path
    names: tuple[str, ...]


def own_certificate(settings: TlsSettings, now: datetime.datetime | None = None) -> OwnCertificate:
    """The certificate that `tls.auto` asks for: the one that is kept, while it holds and names this machine;
    else a new one.

    Args:
        settings: the folder, and further names.
        now: the time, with its zone; by default the machine's.

    Raises:
        SettingsError: the extra is not installed, a name is none, or what is kept cannot be read, is damaged
            or open to others.
    """
    try:
        import ifaddr  # noqa: F401 - rwt.tls.machine uses it

        from rwt.tls import kept
    except ImportError as error:
        raise SettingsError(f"tls.auto: needs {error.name}: pip install cryptography ifaddr segno") from error
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
    """Where the certificate is kept where nothing else is said: in the user's folder for state
    (XDG Base Directory Specification)."""
    state = os.environ.get("XDG_STATE_HOME", "")
    return (Path(state) if os.path.isabs(state) else Path.home() / ".local" / "state") / "rwt" / "tls"


def _names(given: Sequence[str], authority: x509.Certificate, folder: Path) -> tuple[str, ...]:
    """What a server's certificate is to name: this machine as far as its authority may vouch for it, and what
    the settings name."""
    from rwt.tls.authority import vouches_for

    for name in given:
        if not vouches_for(authority, name):
            raise SettingsError(
                f"tls.names: {name}: the authority in {folder} was made without it and cannot vouch for it;"
                " remove that folder to have another made, which devices have to be given anew"
            )
    own = [*machine_names(), *map(str, machine_addresses())]
    return tuple(dict.fromkeys([*given, *(name for name in own if vouches_for(authority, name))]))
