"""Files of the machine's authority and of its server's certificate."""

from __future__ import annotations

import contextlib
import datetime
import logging
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from rwt.access.settings import SettingsError
from rwt.tls.authority import (
    Pair,
    ends_soon,
    make_authority,
    make_server,
    names_in,
    pem,
    pem_of_certificate,
    will_do,
)

logger = logging.getLogger(__name__)

AUTHORITY_ALONE: Final = "authority.crt"
"""Certificate of the authority, to install on devices."""
SERVER: Final = "server.pem"
"""Key and certificate of the server, and the authority's certificate."""
_AUTHORITY: Final = "authority.pem"


def make_folder(folder: Path) -> None:
    """Create the folder if needed.

    Raises:
        SettingsError: others may write in it.
        OSError: it cannot be created.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if os.name == "posix" and folder.stat().st_mode & 0o022:
        raise SettingsError(f"tls.auto: {folder}: others may write in it: expected `chmod 700 {folder}`")


def kept_authority(folder: Path, names: Sequence[str], now: datetime.datetime) -> Pair:
    """Return the authority of a folder; create it if it is missing or about to expire."""
    path = folder / _AUTHORITY
    if (kept := _read(path)) is None:
        _write(path, pem(make_authority(names, now)), replace=False)
        kept = _read(path)  # Another process may have created it first.
    elif ends_soon(kept.certificate, now):
        logger.warning("the authority in %s expires: creating a new one, to be installed on devices", path)
        _write(path, pem(make_authority(names, now)))
        kept = _read(path)
    if kept is None:
        raise SettingsError(f"tls.auto: {path}: it was removed while it was read")
    alone = pem_of_certificate(kept.certificate)
    if not (folder / AUTHORITY_ALONE).is_file() or (folder / AUTHORITY_ALONE).read_bytes() != alone:
        _write(folder / AUTHORITY_ALONE, alone, mode=0o644)
    return kept


def kept_server(
    folder: Path, authority: Pair, wanted: tuple[str, ...], now: datetime.datetime
) -> tuple[str, ...]:
    """Return the names in the server's certificate, which is created unless a valid one exists."""
    path = folder / SERVER
    try:
        kept = _read(path)
    except SettingsError as error:
        # Devices trust the authority, so a server's certificate can be replaced.
        logger.warning("%s; creating another one", error)
        kept = None
    if kept is not None and will_do(kept.certificate, authority.certificate, wanted, now):
        return names_in(kept.certificate)
    made = make_server(authority, wanted, now)
    _write(path, pem(made) + pem_of_certificate(authority.certificate))
    return wanted


def _read(path: Path) -> Pair | None:
    """Read a certificate and its key; return None if there is no file."""
    if not path.exists():
        return None
    if os.name == "posix" and path.stat().st_mode & 0o077:
        raise SettingsError(f"tls.auto: {path}: others may read the key in it: expected `chmod 600 {path}`")
    content = path.read_bytes()
    try:
        key = load_pem_private_key(content, password=None)
        certificate = x509.load_pem_x509_certificates(content)[0]
        _ = certificate.extensions  # Parses them, and raises here.
    except (ValueError, TypeError) as error:
        raise SettingsError(_damaged(path)) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise SettingsError(_damaged(path))
    return Pair(certificate, key)


def _damaged(path: Path) -> str:
    return (
        f"tls.auto: {path}: damaged: expected a certificate and its key in PEM; remove it to have another"
        " made, which devices have to be given anew"
    )


def _write(path: Path, content: bytes, *, mode: int = 0o600, replace: bool = True) -> None:
    """Write a file atomically; without `replace`, keep an existing one."""
    handle, name = tempfile.mkstemp(dir=path.parent)  # Created with mode 0600.
    written = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        written.chmod(mode)
        if replace:
            written.replace(path)
        else:
            with contextlib.suppress(FileExistsError):
                os.link(written, path)
    finally:
        written.unlink(missing_ok=True)
