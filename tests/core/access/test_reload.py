"""Certificates, tokens, roles and origins are read again while the server runs."""

from __future__ import annotations

import asyncio
import datetime
import ipaddress
import json
import logging
import signal
import ssl
import sys
import time
from pathlib import Path
from typing import Any

import httpx
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect as connect_in_thread

from rwt import Server, Settings, SettingsError
from rwt.access.credentials import mac_of
from rwt_protocol import ops
from tests.processes import running

pytestmark = pytest.mark.slow

TOKEN = "0123456789abcdef"
OTHER = "fedcba9876543210"
FREE = {"publish": ["*"], "subscribe": ["*"], "call": ["*"], "provide": ["*"]}
NARROW = {"publish": ["/free"], "subscribe": ["/free"]}


def settings(role: dict[str, Any], token: str = TOKEN, **further: Any) -> Settings:
    return Settings.model_validate(
        {"auth": {"tokens": {"one": {"token": token, "role": "pilot"}}}, "roles": {"pilot": role}, **further}
    )


def asking(url: str, token: str = TOKEN, **further: Any) -> connect:
    return connect(url, additional_headers={"Authorization": f"Bearer {token}"}, **further)


async def ask(client: ClientConnection, op: str, **fields: Any) -> None:
    await client.send(json.dumps({"op": op, **fields}))


async def heard(client: ClientConnection) -> dict[str, Any]:
    message: dict[str, Any] = json.loads(await asyncio.wait_for(client.recv(), 20))
    return message


@pytest.mark.anyio
async def test_roles_of_connected_clients_change_and_what_they_refuse_ends(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    gate = {"audit": {"file": tmp_path / "audit.jsonl"}}
    now = settings(FREE, gate=gate)
    server = Server("ws://127.0.0.1:0", settings=now, reload=lambda: now)
    async with server, asking(server.urls[0]) as client:
        await ask(client, "set_level", level="error")
        for topic in ("/free", "/secret"):
            await ask(client, "subscribe", topic=topic, type="std_msgs/String")
            await ask(client, "advertise", topic=topic, type="std_msgs/String")
        await ask(client, "advertise_service", service="/offered", type="std_srvs/Trigger")
        await ask(client, "publish", topic="/secret", msg={"data": "1"})
        assert (await heard(client))["msg"] == {"data": "1"}
        assert server.graph.service("/offered") is not None

        now = settings(NARROW, gate=gate)
        server.reload()
        assert server.graph.service("/offered") is None
        told = [(await heard(client))["msg"] for _ in range(3)]
        assert [text.partition(":")[0] for text in told] == ["subscribe", "advertise", "advertise_service"]
        assert all("the settings have changed: role 'pilot' may not" in text for text in told)
        for right in ("subscribe", "publish", "provide"):
            assert caplog.text.count(f"roles.pilot.{right}") == 1
        assert "access replaced; changed are roles.pilot" in caplog.text
        audited = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
        assert "access replaced; changed are roles.pilot" in str(audited)
        robot = server.node("robot")
        robot.publish("/secret", {"data": "2"}, "std_msgs/String")
        await ask(client, "publish", topic="/secret", id="p", msg={"data": "3"})
        assert "may not publish" in (await heard(client))["msg"]
        await ask(client, "publish", topic="/free", msg={"data": "4"})
        assert (await heard(client))["topic"] == "/free"

        now = settings(FREE, gate=gate)
        server.reload()
        await ask(client, "subscribe", topic="/secret", type="std_msgs/String")
        await ask(client, "publish", topic="/secret", msg={"data": "5"})
        assert (await heard(client))["msg"] == {"data": "5"}


@pytest.mark.anyio
async def test_tokens_and_origins_are_those_of_the_last_reading() -> None:
    now = settings(FREE)
    server = Server("ws://127.0.0.1:0", settings=now, reload=lambda: now)
    async with server, asking(server.urls[0]) as client:
        now = settings(FREE, OTHER)
        server.reload()
        with pytest.raises(ConnectionClosed) as closed:
            await heard(client)
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, "auth.tokens" in closed.value.rcvd.reason) == (1008, True)
        with pytest.raises(InvalidStatus):
            await asking(server.urls[0])
        with pytest.raises(InvalidStatus):
            await asking(server.urls[0], OTHER, origin="https://ui.example")
        now = settings(FREE, OTHER, origins={"allow": ["https://ui.example"]})
        server.reload()
        async with asking(server.urls[0], OTHER, origin="https://ui.example"), asking(server.urls[0], OTHER):
            pass


@pytest.mark.anyio
@pytest.mark.parametrize("default", [None, "viewer", "admin"])
async def test_the_last_token_is_removed_only_if_a_role_without_one_is_named(default: str | None) -> None:
    now = settings(FREE)
    server = Server("ws://127.0.0.1:0", settings=now, reload=lambda: now)
    async with server, asking(server.urls[0]) as client:
        now = Settings.model_validate({"auth": {"default_role": default}})
        if default is None:
            with pytest.raises(SettingsError, match=r"`auth`: .* `auth\.default_role = "):
                server.reload()
            with pytest.raises(InvalidStatus) as refused:
                await connect(server.urls[0])
            assert refused.value.response.status_code == 401
            await ask(client, "call_service", id="kept", service="/rosapi/get_time")
            assert (await heard(client))["id"] == "kept"
            return
        server.reload()
        with pytest.raises(ConnectionClosed) as closed:
            await heard(client)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008
        with pytest.raises(InvalidStatus) as refused:
            await asking(server.urls[0])
        assert refused.value.response.status_code == 401
        async with connect(server.urls[0]):
            pass


@pytest.mark.anyio
async def test_a_server_without_credentials_keeps_its_narrow_role() -> None:
    now = Settings.model_validate({"auth": {"default_role": "viewer"}})
    server = Server("ws://127.0.0.1:0", settings=now, reload=lambda: now)
    async with server, connect(server.urls[0]) as client:
        now = Settings()
        with pytest.raises(SettingsError, match=r"`auth`: .* `auth\.default_role = "):
            server.reload()
        await ask(client, "set_level", level="error")
        await ask(client, "publish", topic="/cmd_vel", msg={})
        assert "may not publish" in (await heard(client))["msg"]


@pytest.mark.anyio
@pytest.mark.parametrize("also", [{}, {"tokens": {"other": {"token": OTHER, "role": "admin"}}}])
async def test_clients_of_a_replaced_rosauth_secret_are_closed(tmp_path: Path, also: dict[str, Any]) -> None:
    secret = tmp_path / "secret"
    secret.write_text("abcdefghijklmnop\n")
    now = Settings.model_validate({"auth": {"rosauth_secret_file": secret, "rosauth_role": "admin", **also}})
    server = Server("ws://127.0.0.1:0", settings=now, reload=lambda: now)
    async with server, connect(server.urls[0]) as client:
        op = ops.Auth(
            mac="", client="c", dest="d", rand="r", t=int(time.time()), level="", end=int(time.time()) + 999
        )
        op = op.model_copy(update={"mac": mac_of(secret.read_text().strip(), op)})
        await client.send(op.model_dump_json())
        await ask(client, "call_service", id="in", service="/rosapi/get_time")
        assert (await heard(client))["id"] == "in"
        server.reload()
        await ask(client, "call_service", id="kept", service="/rosapi/get_time")
        assert (await heard(client))["id"] == "kept"
        secret.write_text("ponmlkjihgfedcba\n")
        server.reload()
        with pytest.raises(ConnectionClosed) as closed:
            await heard(client)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008


@pytest.mark.anyio
@pytest.mark.parametrize("path", ["/metrics", "/api/v1/topics", "/mcp"])
async def test_an_unknown_token_is_refused_even_if_none_is_required(path: str) -> None:
    async with Server("ws://127.0.0.1:0", gateways=["http", "mcp"]) as server:
        response = await asyncio.to_thread(
            httpx.post if path == "/mcp" else httpx.get,
            server.urls[0].replace("ws:", "http:", 1) + path,
            headers={"Authorization": f"Bearer {TOKEN}"},
        )
    assert response.status_code == 401


def certify(folder: Path, serial: int) -> ssl.SSLContext:
    """Put a certificate and its key into a folder; returns what trusts it."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "robot")])
    start = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
    address = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    builder = x509.CertificateBuilder(name, name, key.public_key(), serial, start, start.replace(year=2120))
    certificate = builder.add_extension(address, critical=False).sign(key, hashes.SHA256())
    (folder / "cert.pem").write_bytes(certificate.public_bytes(Encoding.PEM))
    (folder / "key.pem").write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    return ssl.create_default_context(cafile=folder / "cert.pem")


async def shows(url: str, trust: ssl.SSLContext) -> bool:
    """Return True if a server shows the certificate that is trusted."""
    try:
        async with connect(url, ssl=trust):
            return True
    except ssl.SSLCertVerificationError:
        return False


@pytest.mark.anyio
async def test_a_certificate_is_renewed_and_a_bad_file_keeps_the_old_one(tmp_path: Path) -> None:
    first = certify(tmp_path, 1)
    tls = {"certfile": tmp_path / "cert.pem", "keyfile": tmp_path / "key.pem"}
    server = Server("wss://127.0.0.1:0", tls=tls)
    async with server, connect(server.urls[0], ssl=first) as client:
        (tmp_path / "cert.pem").write_text("nothing")
        with pytest.raises(SettingsError, match="expected a certificate and the key"):
            server.reload()
        assert await shows(server.urls[0], first)
        second = certify(tmp_path, 2)
        server.reload()
        assert await shows(server.urls[0], second)
        assert not await shows(server.urls[0], first)
        await ask(client, "call_service", id="kept", service="/rosapi/get_time")
        assert (await heard(client))["id"] == "kept"


@pytest.mark.parametrize(
    "options",
    [
        (),
        pytest.param(
            ("--workers", "2"),
            marks=pytest.mark.skipif(sys.platform != "linux", reason="workers share ports as Linux does"),
        ),
    ],
)
def test_a_hangup_reads_the_file_again(tmp_path: Path, options: tuple[str, ...]) -> None:
    file = tmp_path / "rwt.toml"

    def write(token: str) -> None:
        file.write_text(f'[auth.tokens.one]\ntoken = "{token}"\nrole = "admin"\n')

    write(TOKEN)
    command = ("serve", "ws://127.0.0.1:0", "--config", str(file), "--verbose", *options)
    with running(*command) as (process, url):
        assert process.stderr is not None
        count = 2 if options else 1

        def hang_up(text: str) -> None:
            process.send_signal(signal.SIGHUP)
            found = 0
            for line in process.stderr or ():
                found += text in line
                if found == count:
                    return
            raise AssertionError(f"the server has ended before it said {text!r} {count} times")

        file.write_text("auth = 5")
        hang_up("the settings stay as they were")
        with connect_in_thread(url, additional_headers={"Authorization": f"Bearer {TOKEN}"}):
            write(OTHER)
            hang_up("were read again")
        for _ in range(4):
            with connect_in_thread(url, additional_headers={"Authorization": f"Bearer {OTHER}"}):
                pass
