"""The URLs that `rwt serve` takes beside `ws://`."""

from __future__ import annotations

import json
import re
import socket
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from websockets.sync.client import connect

from tests.contract.transports.test_listen import certificate as certificate
from tests.processes import running

_CALL = b'{"op":"call_service","id":"1","service":"/rosapi/get_time"}'


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


def test_every_scheme_at_once(certificate: Path, tmp_path: Path) -> None:
    path = tmp_path / "robot.sock"
    urls = [f"{scheme}://127.0.0.1:0" for scheme in ("wss", "tcp", "tcps", "udp")]
    with _serving(
        *urls,
        f"unix://{path}",
        *("--set", f"tls.certfile={certificate}", "--set", f"tls.keyfile={certificate}"),
        count=5,
    ) as (wss, tcp, tcps, udp, unix):
        trust = ssl.create_default_context(cafile=certificate)
        with connect(f"wss://127.0.0.1:{_port(wss)}", ssl=trust) as wire:
            wire.send(_CALL.decode())
            assert _id(wire.recv(timeout=60)) == "1"
        with socket.create_connection(("127.0.0.1", _port(tcp)), 5) as plain:
            plain.sendall(_CALL)
            assert _id(plain.recv(4096)) == "1"
        with (
            socket.create_connection(("127.0.0.1", _port(tcps)), 5) as below,
            trust.wrap_socket(below, server_hostname="127.0.0.1") as encrypted,
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
