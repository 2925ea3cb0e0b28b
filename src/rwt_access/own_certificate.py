"""A certificate of the machine's own making: a small authority, kept for its user, and what that vouches for.

Devices that are to trust the machine are given the authority once. It can vouch for this machine's names and
for private addresses only (RFC 5280 section 4.2.1.10), so that whoever steals its key cannot pass for the
sites of the world.
"""

from __future__ import annotations

import contextlib
import datetime
import ipaddress
import logging
import os
import socket
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rwt_access.settings import SettingsError
from rwt_access.settings.types import is_host_name

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

    from rwt_access.settings import TlsSettings

logger = logging.getLogger(__name__)

Address = ipaddress.IPv4Address | ipaddress.IPv6Address

_AUTHORITY: Final = "authority.pem"
_AUTHORITY_ALONE: Final = "authority.crt"
_SERVER: Final = "server.pem"
_AUTHORITY_DAYS: Final = 3650
_SERVER_DAYS: Final = 90
_RENEW_DAYS: Final = 30
"""Days before its end from which on a certificate is made anew."""
_BEFORE: Final = datetime.timedelta(days=1)
"""How long a certificate holds already when it is made: clocks of devices differ."""
_LOCAL_NAMES: Final = ("localhost", "local", "lan", "internal", "home.arpa")
"""Names that no site of the world has: RFC 6761, RFC 6762, RFC 8375, and what ICANN has set aside."""
_PRIVATE: Final = tuple(
    map(
        ipaddress.ip_network,
        (
            "127.0.0.0/8",
            "10.0.0.0/8",
            "172.16.0.0/12",
            "192.168.0.0/16",
            "169.254.0.0/16",
            "100.64.0.0/10",  # between a provider and its customers (RFC 6598); overlay networks use it, too
            "::1/128",
            "fc00::/7",
        ),
    )
)


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


@dataclass(frozen=True, slots=True)
class _Pair:
    """A certificate and its key."""

    certificate: x509.Certificate
    key: EllipticCurvePrivateKey


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
        import cryptography
        import ifaddr  # noqa: F401 - it is used below
    except ImportError as error:
        raise SettingsError(f"tls.auto: needs {error.name}: pip install cryptography ifaddr segno") from error
    assert cryptography
    now = now or datetime.datetime.now(datetime.UTC)
    folder = settings.folder or default_folder()
    try:
        _make_folder(folder)
        authority = _kept_authority(folder, settings.names, now)
        wanted = _names(settings.names, authority.certificate, folder)
        names = _kept_server(folder, authority, wanted, now)
    except OSError as error:
        raise SettingsError(f"tls.auto: {error.filename or folder}: {error.strerror}") from error
    from cryptography.hazmat.primitives import hashes

    fingerprint = authority.certificate.fingerprint(hashes.SHA256()).hex(":").upper()
    return OwnCertificate(folder / _AUTHORITY_ALONE, fingerprint, folder / _SERVER, names)


def default_folder() -> Path:
    """Where the certificate is kept where nothing else is said: in the user's folder for state
    (XDG Base Directory Specification)."""
    state = os.environ.get("XDG_STATE_HOME", "")
    return (Path(state) if os.path.isabs(state) else Path.home() / ".local" / "state") / "rwt" / "tls"


def machine_addresses() -> tuple[Address, ...]:
    """The addresses of this machine's interfaces, the one that leads to other networks first.

    Link-local ones of IPv6 are left out: browsers cannot be given one, for want of its zone.
    """
    import ifaddr

    found: list[Address] = []
    for adapter in ifaddr.get_adapters():
        for each in adapter.ips:
            # ifaddr has IPv6 as address, flow and zone.
            address = ipaddress.ip_address(each.ip if isinstance(each.ip, str) else each.ip[0])
            if not (address.version == 6 and address.is_link_local):
                found.append(address)
    first = _outward_address()
    return tuple(
        sorted(dict.fromkeys(found), key=lambda it: (it != first, it.is_loopback, it.version, int(it)))
    )


def _outward_address() -> Address | None:
    """Which of its addresses this machine would use towards another network; nothing is sent."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # An address for documents (RFC 5737), the port of discard.
        return ipaddress.ip_address(probe.getsockname()[0])
    return None


def _machine_names() -> list[str]:
    host = socket.gethostname()
    first = host.partition(".")[0]
    return [name for name in ("localhost", host, f"{first}.local") if is_host_name(name)]


def _names(given: Sequence[str], authority: x509.Certificate, folder: Path) -> tuple[str, ...]:
    """What a server's certificate is to name: this machine as far as its authority may vouch for it, and what
    the settings name."""
    for name in given:
        if not _vouches_for(authority, name):
            raise SettingsError(
                f"tls.names: {name}: the authority in {folder} was made without it and cannot vouch for it;"
                " remove that folder to have another made, which devices have to be given anew"
            )
    own = [*_machine_names(), *map(str, machine_addresses())]
    return tuple(dict.fromkeys([*given, *(name for name in own if _vouches_for(authority, name))]))


def _vouches_for(authority: x509.Certificate, name: str) -> bool:
    from cryptography import x509

    permitted = authority.extensions.get_extension_for_class(x509.NameConstraints).value.permitted_subtrees
    address = _address(name)
    for each in permitted or ():
        if address is None and isinstance(each, x509.DNSName):
            if name.lower() == each.value or name.lower().endswith(f".{each.value}"):
                return True
        elif address is not None and isinstance(each, x509.IPAddress):
            network = each.value
            if isinstance(network, ipaddress.IPv4Network | ipaddress.IPv6Network) and address in network:
                return True
    return False


def _address(name: str) -> Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


# Files


def _make_folder(folder: Path) -> None:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if os.name == "posix" and folder.stat().st_mode & 0o022:
        raise SettingsError(f"tls.auto: {folder}: others may write in it: expected `chmod 700 {folder}`")


def _kept_authority(folder: Path, names: Sequence[str], now: datetime.datetime) -> _Pair:
    """The authority of a folder; a new one where there is none, or where it has come to its end."""
    path = folder / _AUTHORITY
    if (kept := _read(path)) is None:
        _write(path, _pem(_make_authority(names, now)), replace=False)
        kept = _read(path)  # Another process may have been first.
    elif _ends_soon(kept.certificate, now):
        logger.warning("the authority in %s has come to its end; devices have to be given the new one", path)
        _write(path, _pem(_make_authority(names, now)))
        kept = _read(path)
    if kept is None:
        raise SettingsError(f"tls.auto: {path}: it was removed while it was read")
    alone = _pem_certificate(kept.certificate)
    if not (folder / _AUTHORITY_ALONE).is_file() or (folder / _AUTHORITY_ALONE).read_bytes() != alone:
        _write(folder / _AUTHORITY_ALONE, alone, mode=0o644)
    return kept


def _kept_server(
    folder: Path, authority: _Pair, wanted: tuple[str, ...], now: datetime.datetime
) -> tuple[str, ...]:
    """The names in the server's certificate, which is made where there is none that will do."""
    path = folder / _SERVER
    try:
        kept = _read(path)
    except SettingsError as error:
        # Nobody but this machine goes by it, other than by its authority.
        logger.warning("%s; another one is made", error)
        kept = None
    if kept is not None and _will_do(kept.certificate, authority.certificate, wanted, now):
        return _names_in(kept.certificate)
    made = _make_server(authority, wanted, now)
    _write(path, _pem(made) + _pem_certificate(authority.certificate))
    return wanted


def _read(path: Path) -> _Pair | None:
    """A certificate and its key from a file; None where there is none.

    Raises:
        SettingsError: it is damaged, or open to others.
        OSError: it cannot be read.
    """
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    if not path.exists():
        return None
    if os.name == "posix" and path.stat().st_mode & 0o077:
        raise SettingsError(f"tls.auto: {path}: others may read the key in it: expected `chmod 600 {path}`")
    content = path.read_bytes()
    try:
        key = load_pem_private_key(content, password=None)
        certificate = x509.load_pem_x509_certificates(content)[0]
        certificate.extensions  # noqa: B018 - they are parsed now, and raise here
    except (ValueError, TypeError) as error:
        raise SettingsError(_damaged(path)) from error
    if not isinstance(key, EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise SettingsError(_damaged(path))
    return _Pair(certificate, key)


def _damaged(path: Path) -> str:
    return (
        f"tls.auto: {path}: damaged: expected a certificate and its key in PEM; remove it to have another"
        " made, which devices have to be given anew"
    )


def _write(path: Path, content: bytes, *, mode: int = 0o600, replace: bool = True) -> None:
    """Put a whole file where it belongs, or nothing; without `replace` one that is there stays."""
    handle, name = tempfile.mkstemp(dir=path.parent)  # For its owner alone, from its first byte on.
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


# Certificates


def _ends_soon(certificate: x509.Certificate, now: datetime.datetime) -> bool:
    return certificate.not_valid_after_utc - now < datetime.timedelta(days=_RENEW_DAYS)


def _names_in(certificate: x509.Certificate) -> tuple[str, ...]:
    from cryptography import x509

    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    addresses = names.get_values_for_type(x509.IPAddress)
    return (*names.get_values_for_type(x509.DNSName), *map(str, addresses))


def _will_do(
    certificate: x509.Certificate,
    authority: x509.Certificate,
    wanted: Iterable[str],
    now: datetime.datetime,
) -> bool:
    """Whether a server's certificate holds for a while, is of that authority, and has all names."""
    from cryptography.exceptions import InvalidSignature

    if _ends_soon(certificate, now) or certificate.not_valid_before_utc > now:
        return False
    try:
        certificate.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError):
        return False
    return set(wanted) <= set(_names_in(certificate))


def _make_authority(names: Sequence[str], now: datetime.datetime) -> _Pair:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    key = ec.generate_private_key(ec.SECP256R1())
    host = socket.gethostname()
    subject = x509.Name(
        [
            x509.NameAttribute(NameOID.ORGANIZATION_NAME, "Robot Web Tools"),
            x509.NameAttribute(NameOID.COMMON_NAME, f"Robot Web Tools on {host}"[:64]),
        ]
    )
    dns = dict.fromkeys([*_LOCAL_NAMES, *_machine_names(), *(each for each in names if not _address(each))])
    addresses = [ipaddress.ip_network(each) for each in names if _address(each)]
    constraints = x509.NameConstraints(
        [
            *(x509.DNSName(each.lower()) for each in dns),
            *(x509.IPAddress(each) for each in (*_PRIVATE, *addresses)),
        ],
        None,
    )
    builder = (
        _certificate(subject, subject, key, key, now, _AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
        .add_extension(constraints, critical=True)
    )
    return _Pair(builder.sign(key, hashes.SHA256()), key)


def _make_server(authority: _Pair, names: Sequence[str], now: datetime.datetime) -> _Pair:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Robot Web Tools server")])
    alternatives = [
        x509.DNSName(name) if (address := _address(name)) is None else x509.IPAddress(address)
        for name in names
    ]
    builder = (
        _certificate(subject, authority.certificate.subject, key, authority.key, now, _SERVER_DAYS)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
    )
    return _Pair(builder.sign(authority.key, hashes.SHA256()), key)


def _certificate(
    subject: x509.Name,
    issuer: x509.Name,
    key: EllipticCurvePrivateKey,
    issuer_key: EllipticCurvePrivateKey,
    now: datetime.datetime,
    days: int,
) -> x509.CertificateBuilder:
    """What authority and server have alike."""
    from cryptography import x509

    builder = x509.CertificateBuilder(
        issuer,
        subject,
        key.public_key(),
        x509.random_serial_number(),
        now - _BEFORE,
        now + datetime.timedelta(days=days),
    )
    return builder.add_extension(
        x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False
    ).add_extension(
        x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), critical=False
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    from cryptography import x509

    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _pem_certificate(certificate: x509.Certificate) -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding

    return certificate.public_bytes(Encoding.PEM)


def _pem(pair: _Pair) -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    key = pair.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return key + _pem_certificate(pair.certificate)
