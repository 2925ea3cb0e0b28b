"""The URLs that `rwt serve` takes beside `ws://`, and what it says of those that it cannot."""

from __future__ import annotations

import datetime
import json
import re
import socket
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from websockets.sync.client import connect

from tests.processes import ended, running

_CALL = b'{"op":"call_service","id":"1","service":"/rosapi/get_time"}'


@pytest.fixture(scope="module")
def pem(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate for localhost, and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "robot")])
    start = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
    signed = (
        x509.CertificateBuilder(name, name, key.public_key(), 1, start, start.replace(year=2120))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("localhost")]), critical=False)
        .sign(key, hashes.SHA256())
    )
    folder = tmp_path_factory.mktemp("tls")
    certfile, keyfile = folder / "cert.pem", folder / "key.pem"
    certfile.write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    keyfile.write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
    )
    return certfile, keyfile


@contextmanager
def _serving(*arguments: str, count: int) -> Iterator[list[str]]:
    with running("serve", *arguments) as (process, first):
        assert process.stdout is not None
        others = [process.stdout.readline() for _ in range(count - 1)]
        assert all(line.startswith("listening on ") for line in others), others
        yield [first, *(line.removeprefix("listening on ").strip() for line in others)]


def _port(url: str) -> int:
    match = re.search(r":(\d+)$", url)
    assert match is not None, url
    return int(match[1])


def _id(answer: str | bytes) -> object:
    return json.loads(answer)["id"]


def test_every_scheme_at_once(pem: tuple[Path, Path], tmp_path: Path) -> None:
    certfile, keyfile = pem
    path = tmp_path / "robot.sock"
    with _serving(
        *(
            "wss://127.0.0.1:0",
            "tcp://127.0.0.1:0",
            "tcps://127.0.0.1:0",
            f"unix://{path}",
            "udp://127.0.0.1:0",
        ),
        *("--set", f"tls.certfile={certfile}", "--set", f"tls.keyfile={keyfile}"),
        count=5,
    ) as (wss, tcp, tcps, unix, udp):
        trust = ssl.create_default_context(cafile=certfile)
        with connect(f"wss://localhost:{_port(wss)}", ssl=trust) as wire:
            wire.send(_CALL.decode())
            assert _id(wire.recv(timeout=60)) == "1"
        with socket.create_connection(("127.0.0.1", _port(tcp)), 5) as plain:
            plain.sendall(_CALL)
            assert _id(plain.recv(4096)) == "1"
        with (
            socket.create_connection(("127.0.0.1", _port(tcps)), 5) as below,
            trust.wrap_socket(below, server_hostname="localhost") as encrypted,
        ):
            encrypted.sendall(_CALL)
            assert _id(encrypted.recv(4096)) == "1"
        assert unix == f"unix://{path}"
        with socket.socket(socket.AF_UNIX) as local:
            local.settimeout(5)
            local.connect(str(path))
            local.sendall(_CALL)
            assert _id(local.recv(4096)) == "1"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams:
            datagrams.settimeout(5)
            datagrams.connect(("127.0.0.1", _port(udp)))
            datagrams.send(_CALL)
            assert _id(datagrams.recv(65_535)) == "1"
    assert not path.exists()


def test_a_reply_that_does_not_fit_a_datagram_says_so() -> None:
    names = [f"/{at:03}{'a' * 500}" for at in range(180)]
    with (
        _serving("udp://127.0.0.1:0", count=1) as (url,),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams,
    ):
        datagrams.settimeout(5)
        datagrams.connect(("127.0.0.1", _port(url)))
        for at in range(0, len(names), 90):
            offers = [
                {"op": "advertise", "topic": name, "type": "std_msgs/String"} for name in names[at : at + 90]
            ]
            datagrams.send("".join(map(json.dumps, offers)).encode())
        call = {"op": "call_service", "id": "1", "service": "/rosapi/topics"}
        datagrams.send(json.dumps(call).encode())
        answer = json.loads(datagrams.recv(65_535))
        assert answer["result"] is False
        assert "udp carries 65507" in answer["values"]
        datagrams.send(json.dumps({**call, "fragment_size": 40_000}).encode())
        pieces = [json.loads(datagrams.recv(65_535)) for _ in range(3)]
        assert [(piece["op"], piece["num"]) for piece in pieces] == [("fragment", at) for at in range(3)]
        whole = json.loads("".join(piece["data"] for piece in pieces))
        assert set(names) <= set(whole["values"]["topics"])


def _fails(*arguments: str) -> str:
    done = ended("serve", *arguments)
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    return done.stderr


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("wss://127.0.0.1:0", "needs a certificate and a key"),
        ("tcps://127.0.0.1:0", "tls.certfile"),
        ("stdio://robot", "no address"),
        ("stdio", "stdio:"),
        ("unix://robot.sock", "absolute path"),
        ("unix:///no/such/folder/robot.sock", "No such file"),
        ("udp://", "names no host"),
        ("udp://127.0.0.1:0/path", "only a host and a port"),
        ("udp://192.0.2.1:9092", "not an address of this machine"),
        ("udp://no.such.host.invalid:9092", "is not known"),
    ],
)
def test_a_url_that_cannot_be_served_is_one_line(url: str, expected: str) -> None:
    assert expected in _fails(url)


def test_a_port_that_others_have_is_one_line() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        assert "is in use" in _fails(f"udp://127.0.0.1:{taken.getsockname()[1]}")
