"""Answers of STUN and TURN servers, and errors without one."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import subprocess
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import pytest

from bench.network.nat import StunServer
from rwt import Server
from rwt_transports.errors import ConnectError
from rwt_webrtc.diagnosis import examine_ice_servers
from rwt_webrtc.settings import WebRtcSettings
from rwt_webrtc.transport import ice_servers
from rwt_webrtc.transport.ice_servers import BadIceServer, IceServer, probe, read_configuration

pytestmark = pytest.mark.anyio

TURNSERVER = shutil.which("turnserver")


@asynccontextmanager
async def stun_server() -> AsyncIterator[str]:
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(StunServer, local_addr=("127.0.0.1", 0))
    try:
        yield f"stun:127.0.0.1:{transport.get_extra_info('sockname')[1]}"
    finally:
        transport.close()


@contextmanager
def silent_port() -> Iterator[int]:
    """Where datagrams come to, and nothing is answered."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.bind(("127.0.0.1", 0))
        yield deaf.getsockname()[1]


@contextmanager
def turn_server(folder: Path) -> Iterator[str]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = ["--listening-ip=127.0.0.1", "--relay-ip=127.0.0.1", f"--listening-port={port}"]
    files = [f"--pidfile={folder}/pid", f"--userdb={folder}/users", "--log-file=stdout"]
    who = ["--lt-cred-mech", "--user=me:right", "--realm=test"]
    process = subprocess.Popen(
        [str(TURNSERVER), "-n", *address, *files, *who, "--no-cli", "--no-tls", "--no-dtls"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield f"turn:127.0.0.1:{port}?transport=udp"
    finally:
        process.kill()
        process.wait()


async def test_a_stun_server_tells_how_it_sees_us() -> None:
    async with stun_server() as url:
        seen = await probe(IceServer(url))
    assert seen.works
    assert seen.text.startswith("it sees this machine as 127.0.0.1:")


@pytest.mark.parametrize("scheme", ["stun", "turn"])
async def test_a_server_that_does_not_answer(scheme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ice_servers, "SECONDS", 0.2)
    with silent_port() as port:
        seen = await probe(IceServer(f"{scheme}:127.0.0.1:{port}", "me", "right"))
    assert (seen.works, seen.text) == (False, "it does not answer within 0.2 s")


async def test_a_server_whose_name_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    async def unknown(*given: object, **named: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(asyncio.get_running_loop(), "getaddrinfo", unknown)
    seen = await probe(IceServer("stun:nowhere.invalid"))
    assert (seen.works, seen.text) == (False, "its name is not known here: Name or service not known")


@pytest.mark.skipif(TURNSERVER is None, reason="needs coturn's turnserver")
async def test_a_turn_server_refuses_a_wrong_credential(tmp_path: Path) -> None:
    with turn_server(tmp_path) as url:
        for _ in range(10):  # It says nothing until it is up.
            right = await probe(IceServer(url, "me", "right"))
            if right.works:
                break
        assert right.text.startswith("it relays by 127.0.0.1:")
        wrong = await probe(IceServer(url, "me", "wrong"))
    assert (wrong.works, wrong.text) == (False, "it refuses the credential of 'me' (401 Unauthorized)")


async def test_what_the_doctor_says_of_the_servers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ice_servers, "SECONDS", 0.5)
    async with stun_server() as good:
        with silent_port() as port:
            bad = f"stun:127.0.0.1:{port}"
            settings = WebRtcSettings(enabled=True, servers=(good, bad))
            async with Server("ws://127.0.0.1:0", webrtc=settings) as server:
                url = server.urls[0].replace("ws", "webrtc+http", 1)
                found = await examine_ice_servers(url, None, None)
    assert [each.verdict for each in found] == ["ok", "warning"]
    assert [each.text.startswith(of) for each, of in zip(found, (good, bad), strict=True)] == [True, True]
    assert "webrtc.servers" in found[1].advice


async def test_the_doctor_says_where_there_are_none_and_where_nobody_answers() -> None:
    async with Server("ws://127.0.0.1:0", webrtc=WebRtcSettings(enabled=True)) as server:
        url = server.urls[0].replace("ws", "webrtc+http", 1)
        (finding,) = await examine_ice_servers(url, None, None)
    assert (finding.verdict, "names no STUN or TURN server" in finding.text) == ("note", True)
    with pytest.raises(ConnectError) as failed:
        await examine_ice_servers(url, None, None)
    assert failed.value.cause == "refused"


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (b"no", "as JSON"),
        (b"[]", "as JSON"),
        (b'{"iceServers": [1]}', "as JSON"),
        (b'{"iceServers": [{}]}', "like"),
        (b'{"iceServers": [{"urls": "http://x"}]}', "no STUN or TURN server"),
        (b'{"iceServers": [{"urls": "turn:x", "username": 1}]}', "no texts"),
        (json.dumps({"iceServers": [{"urls": ["stun:x"] * 9}]}).encode(), "9 STUN and TURN servers"),
        (b"[" * 100_000, "as JSON"),
    ],
)
def test_what_is_no_configuration(body: bytes, why: str) -> None:
    with pytest.raises(BadIceServer, match=why):
        read_configuration(body)


def test_a_configuration() -> None:
    body = {"iceServers": [{"urls": ["stun:a", "turn:b"], "username": "me", "credential": "c"}]}
    assert read_configuration(json.dumps(body).encode()) == (
        IceServer("stun:a", "me", "c"),
        IceServer("turn:b", "me", "c"),
    )
