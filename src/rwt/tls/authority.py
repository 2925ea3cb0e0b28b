"""Certificate authority of the machine, and server certificates that it signs.

The authority is constrained to this machine's names and private addresses (RFC 5280 section 4.2.1.10), so a
stolen key cannot impersonate public sites.
"""

from __future__ import annotations

import datetime
import ipaddress
import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from rwt.tls.machine import Address, machine_names

_AUTHORITY_DAYS: Final = 3650
_SERVER_DAYS: Final = 90
_RENEW_DAYS: Final = 30
"""Remaining days below which a certificate is renewed."""
_BEFORE: Final = datetime.timedelta(days=1)
"""Backdating of new certificates: the clocks of devices differ."""
_LOCAL_NAMES: Final = ("localhost", "local", "lan", "internal", "home.arpa")
"""Names that are never public: RFC 6761, RFC 6762, RFC 8375, and those reserved by ICANN."""
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
class Pair:
    """Certificate with its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def vouches_for(authority: x509.Certificate, name: str) -> bool:
    """True if the constraints of an authority permit a name or an address."""
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


def ends_soon(certificate: x509.Certificate, now: datetime.datetime) -> bool:
    """True if the certificate is due for renewal."""
    return certificate.not_valid_after_utc - now < datetime.timedelta(days=_RENEW_DAYS)


def names_in(certificate: x509.Certificate) -> tuple[str, ...]:
    """Return the names and addresses in a server's certificate."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    addresses = names.get_values_for_type(x509.IPAddress)
    return (*names.get_values_for_type(x509.DNSName), *map(str, addresses))


def will_do(
    certificate: x509.Certificate,
    authority: x509.Certificate,
    wanted: Iterable[str],
    now: datetime.datetime,
) -> bool:
    """True if a server's certificate is valid, issued by that authority, and contains all names."""
    if ends_soon(certificate, now) or certificate.not_valid_before_utc > now:
        return False
    try:
        certificate.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError):
        return False
    return set(wanted) <= set(names_in(certificate))


def make_authority(names: Sequence[str], now: datetime.datetime) -> Pair:
    """Create an authority for this machine's names, private addresses, and the given names."""
    key = ec.generate_private_key(ec.SECP256R1())
    host = socket.gethostname()
    subject = x509.Name(
        [
            x509.NameAttribute(NameOID.ORGANIZATION_NAME, "Robot Web Tools"),
            x509.NameAttribute(NameOID.COMMON_NAME, f"Robot Web Tools on {host}"[:64]),
        ]
    )
    dns = dict.fromkeys([*_LOCAL_NAMES, *machine_names(), *(each for each in names if not _address(each))])
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
    return Pair(builder.sign(key, hashes.SHA256()), key)


def make_server(authority: Pair, names: Sequence[str], now: datetime.datetime) -> Pair:
    """Create a server certificate for these names, signed by the authority."""
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
    return Pair(builder.sign(authority.key, hashes.SHA256()), key)


def _certificate(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    issuer_key: ec.EllipticCurvePrivateKey,
    now: datetime.datetime,
    days: int,
) -> x509.CertificateBuilder:
    """Return the builder that authority and server have in common."""
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


def pem_of_certificate(certificate: x509.Certificate) -> bytes:
    """Encode a certificate as PEM."""
    return certificate.public_bytes(Encoding.PEM)


def pem(pair: Pair) -> bytes:
    """Encode a key and its certificate as PEM."""
    key = pair.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return key + pem_of_certificate(pair.certificate)
