"""The certificate that a server makes itself: who accepts it, for how long, and what is wrong with files."""

from __future__ import annotations

import datetime
import ipaddress
import logging
import os
import ssl
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from websockets.asyncio.client import connect

from rwt import Server, SettingsError
from rwt.access.settings import TlsSettings
from rwt.tls.own_certificate import default_folder, own_certificate
from rwt_graph import SimulatedClock

NOW = datetime.datetime(2030, 6, 1, tzinfo=datetime.UTC)
DAY = datetime.timedelta(days=1)


def kept_in(folder: Path, *names: str) -> TlsSettings:
    return TlsSettings(auto=True, folder=folder, names=names)


def leaf(folder: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificates((folder / "server.pem").read_bytes())[0]


async def accepts(url: str, authority: Path) -> bool:
    """Return True if a client that trusts an authority alone connects."""
    try:
        async with connect(url, ssl=ssl.create_default_context(cafile=authority)):
            return True
    except ssl.SSLCertVerificationError:
        return False


def verified(authority: Path, file: Path, *options: str) -> str:
    """Return what OpenSSL finds wrong with a certificate; empty if nothing."""
    found = subprocess.run(
        ["openssl", "verify", *options, "-CAfile", authority, file],
        capture_output=True,
        text=True,
        check=False,
    )
    return found.stderr if found.returncode else ""


@pytest.mark.anyio
async def test_who_trusts_the_authority_connects_and_a_second_start_shows_the_same(tmp_path: Path) -> None:
    folder = tmp_path / "state" / "tls"
    tls = {"auto": True, "folder": folder}
    async with Server("wss://localhost:0", "wss://127.0.0.1:0", tls=tls) as server:
        for url in server.urls:
            assert await accepts(url, folder / "authority.crt")
        with pytest.raises(ssl.SSLCertVerificationError):
            await connect(server.urls[0], ssl=ssl.create_default_context())
    shown = (folder / "server.pem").read_bytes()
    async with Server("wss://127.0.0.1:0", tls=tls) as server:
        assert await accepts(server.urls[0], folder / "authority.crt")
    assert (folder / "server.pem").read_bytes() == shown


@pytest.mark.anyio
async def test_a_running_server_shows_the_next_certificate_within_an_hour(tmp_path: Path) -> None:
    clock = SimulatedClock()
    async with Server("wss://127.0.0.1:0", tls={"auto": True, "folder": tmp_path}, clock=clock) as server:
        before = tmp_path / "before.crt"
        before.write_bytes((tmp_path / "authority.crt").read_bytes())
        for each in ("authority.pem", "server.pem"):
            (tmp_path / each).unlink()
        assert await accepts(server.urls[0], before)
        clock.advance(3600.0)
        assert not await accepts(server.urls[0], before)
        assert await accepts(server.urls[0], tmp_path / "authority.crt")


def test_openssl_finds_nothing_wrong_with_the_chain(tmp_path: Path) -> None:
    made = own_certificate(kept_in(tmp_path, "robot.example.org", "203.0.113.7"))
    assert {"localhost", "127.0.0.1", "robot.example.org", "203.0.113.7"} <= set(made.names)
    (tmp_path / "leaf.crt").write_bytes(leaf(tmp_path).public_bytes(Encoding.PEM))
    for option, name in (("-verify_hostname", "robot.example.org"), ("-verify_ip", "203.0.113.7")):
        options = ("-x509_strict", "-purpose", "sslserver", option, name)
        assert verified(made.authority, tmp_path / "leaf.crt", *options) == ""


@pytest.mark.parametrize("name", ["example.org", "8.8.8.8"])
def test_the_authority_cannot_vouch_for_the_sites_of_the_world(tmp_path: Path, name: str) -> None:
    made = own_certificate(kept_in(tmp_path))
    key = load_pem_private_key((tmp_path / "authority.pem").read_bytes(), password=None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    authority = x509.load_pem_x509_certificate(made.authority.read_bytes())
    forged = x509.CertificateBuilder(
        authority.subject,
        x509.Name([]),
        ec.generate_private_key(ec.SECP256R1()).public_key(),
        7,
        authority.not_valid_before_utc,
        authority.not_valid_after_utc,
    )
    names = [x509.DNSName(name) if name[0].isalpha() else x509.IPAddress(ipaddress.ip_address(name))]
    forged = forged.add_extension(x509.SubjectAlternativeName(names), critical=True)
    (tmp_path / "forged.crt").write_bytes(forged.sign(key, hashes.SHA256()).public_bytes(Encoding.PEM))
    assert "permitted subtree violation" in verified(made.authority, tmp_path / "forged.crt")


def test_it_is_made_anew_before_its_end_and_where_the_clock_was_wrong(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = own_certificate(kept_in(tmp_path), NOW)
    one = leaf(tmp_path)
    own_certificate(kept_in(tmp_path), NOW + 59 * DAY)
    assert leaf(tmp_path) == one
    own_certificate(kept_in(tmp_path), NOW + 61 * DAY)
    assert leaf(tmp_path).not_valid_after_utc == NOW + 151 * DAY
    own_certificate(kept_in(tmp_path), NOW - 30 * DAY)
    assert leaf(tmp_path).not_valid_before_utc == NOW - 31 * DAY
    assert own_certificate(kept_in(tmp_path), NOW).fingerprint == first.fingerprint
    with caplog.at_level(logging.WARNING):
        later = own_certificate(kept_in(tmp_path), NOW + 3649 * DAY)
    assert later.fingerprint != first.fingerprint, "the authority is at its end, too"
    assert "to be installed on devices" in caplog.text


def test_a_new_name_has_it_made_anew_or_is_refused_where_the_authority_cannot_vouch(tmp_path: Path) -> None:
    own_certificate(kept_in(tmp_path))
    assert "arm.local" in own_certificate(kept_in(tmp_path, "arm.local")).names
    with pytest.raises(SettingsError, match=r"tls\.names: robot\.example\.org: .*remove that folder"):
        own_certificate(kept_in(tmp_path, "robot.example.org"))


def test_many_who_begin_at_once_have_one_authority(tmp_path: Path) -> None:
    barrier = threading.Barrier(8)

    def begin(_: int) -> str:
        barrier.wait()
        return own_certificate(kept_in(tmp_path)).fingerprint

    with ThreadPoolExecutor(8) as threads:
        assert len(set(threads.map(begin, range(8)))) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"authority.crt", "authority.pem", "server.pem"}


def test_files_are_for_their_user_alone(tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    own_certificate(kept_in(folder))
    assert folder.stat().st_mode & 0o777 == 0o700
    for name in ("authority.pem", "server.pem"):
        assert (folder / name).stat().st_mode & 0o777 == 0o600
    assert b"PRIVATE" not in (folder / "authority.crt").read_bytes()


@pytest.mark.parametrize("damage", [b"", b"nothing", b"half"])
def test_a_damaged_authority_is_said_and_a_damaged_certificate_is_made_anew(
    tmp_path: Path, damage: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    first = own_certificate(kept_in(tmp_path))
    for name in ("server.pem", "authority.pem"):
        path = tmp_path / name
        path.write_bytes(path.read_bytes()[:400] if damage == b"half" else damage)
        path.chmod(0o600)
        if name == "server.pem":
            with caplog.at_level(logging.WARNING):
                assert own_certificate(kept_in(tmp_path)).fingerprint == first.fingerprint
            assert f"{path}: damaged" in caplog.text
    with pytest.raises(SettingsError, match=r"authority\.pem: damaged: .* remove it to have another made"):
        own_certificate(kept_in(tmp_path))


def test_files_that_are_open_to_others_or_cannot_be_read_are_said(tmp_path: Path) -> None:
    own_certificate(kept_in(tmp_path))
    (tmp_path / "authority.pem").chmod(0o644)
    with pytest.raises(SettingsError, match=r"others may read the key in it: expected `chmod 600"):
        own_certificate(kept_in(tmp_path))
    tmp_path.chmod(0o777)
    with pytest.raises(SettingsError, match=r"others may write in it: expected `chmod 700"):
        own_certificate(kept_in(tmp_path))
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match=r"tls\.auto: .*file: (File exists|Not a directory)"):
        own_certificate(kept_in(tmp_path / "file"))


@pytest.mark.parametrize(
    "name", ["", "-", "a..b", "a b", "ö.example", "*.example.org", "a" * 64, "1.2.3.4/8"]
)
def test_what_is_no_name_is_refused_by_the_settings(name: str) -> None:
    with pytest.raises(ValueError, match="no name or address of a host"):
        TlsSettings(auto=True, names=(name,))


def test_the_folder_is_that_of_the_user_where_none_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/somewhere")
    assert default_folder() == Path("/somewhere/rwt/tls")
    monkeypatch.setenv("XDG_STATE_HOME", "not/absolute")
    assert default_folder() == Path(os.path.expanduser("~/.local/state/rwt/tls"))
