"""Encrypted listeners, with their certificate from the settings; certificates that are none."""

from __future__ import annotations

import datetime
import ipaddress
import json
import ssl
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    KeySerializationEncryption,
    NoEncryption,
    PrivateFormat,
)
from cryptography.x509.oid import NameOID
from websockets.asyncio.client import connect

from rwt import Server, Settings, SettingsError


def _key_file(path: Path, key: ec.EllipticCurvePrivateKey, encryption: KeySerializationEncryption) -> Path:
    path.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, encryption))
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a certificate for 127.0.0.1, its key, that key with a password, and another key."""
    folder = tmp_path_factory.mktemp("tls")
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "robot")])
    start = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
    address = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    builder = x509.CertificateBuilder(name, name, key.public_key(), 1, start, start.replace(year=2120))
    certificate = builder.add_extension(address, critical=False).sign(key, hashes.SHA256())
    (folder / "cert.pem").write_bytes(certificate.public_bytes(Encoding.PEM))
    _key_file(folder / "key.pem", key, NoEncryption())
    _key_file(folder / "locked.pem", key, BestAvailableEncryption(b"password"))
    _key_file(folder / "other.pem", ec.generate_private_key(ec.SECP256R1()), NoEncryption())
    (folder / "text.pem").write_text("this is no key")
    return folder


def _settings(folder: Path, certificate: str, key: str) -> Settings:
    return Settings.model_validate({"tls": {"certfile": folder / certificate, "keyfile": folder / key}})


@pytest.mark.anyio
async def test_wss_with_a_certificate_from_files(files: Path) -> None:
    settings = _settings(files, "cert.pem", "key.pem")
    async with Server("wss://127.0.0.1:0", settings=settings) as server:
        trust = ssl.create_default_context(cafile=str(files / "cert.pem"))
        async with connect(server.urls[0], ssl=trust, compression=None) as wire:
            await wire.send(json.dumps({"op": "subscribe", "topic": "/x", "type": "std_msgs/String"}))
            await wire.send(json.dumps({"op": "publish", "topic": "/x", "msg": {"data": "y"}}))
            assert json.loads(await wire.recv())["msg"] == {"data": "y"}


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("certificate", "key", "expected"),
    [
        ("none.pem", "key.pem", r"tls\.certfile: .*none\.pem: cannot be read: No such file"),
        ("cert.pem", "none.pem", r"tls\.keyfile: .*none\.pem: cannot be read: No such file"),
        ("cert.pem", "other.pem", "the key that belongs to it"),
        ("cert.pem", "locked.pem", "without a password"),
        ("cert.pem", "text.pem", "both in PEM"),
        ("text.pem", "key.pem", "both in PEM"),
        ("cert.pem", ".", "cannot be read"),
    ],
)
async def test_what_is_wrong_with_the_files_is_said(
    files: Path, certificate: str, key: str, expected: str
) -> None:
    with pytest.raises(SettingsError, match=expected):
        async with Server("wss://127.0.0.1:0", settings=_settings(files, certificate, key)):
            raise AssertionError("it serves")
