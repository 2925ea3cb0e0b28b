"""A client that has not authenticated holds almost no memory: its messages and bodies are small."""

from __future__ import annotations

import hashlib
import json
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import pytest
from websockets.exceptions import ConnectionClosed

from tests.faults.isolation.greedy_clients import (
    GREEDY,
    OTHER,
    ask_buffer,
    connected,
    frame_head,
    request,
    send_unfinished,
)
from tests.faults.isolation.served import LONGEST_S, Client, Served, served

SECRET: Final = "abcdefghijklmnop"
TOKEN: Final = "a-token-of-some-length"
LIMIT: Final = 4096

#: No time-out may end what the limit of the size should end.
PATIENT: Final = "auth.seconds = 3600.0\nlimits.handshake_seconds = 3600.0\n"


LARGE: Final[dict[str, Any]] = {
    "op": "publish", "topic": "/large", "type": "std_msgs/String", "msg": {"data": "x" * 200_000}
}  # fmt: skip


def settings(folder: Path) -> str:
    """Return settings with a secret of rosauth and a token."""
    secret = folder / "secret"
    secret.write_text(f"{SECRET}\n")
    token = f'auth.tokens.operator = {{ token = "{TOKEN}", role = "admin" }}\n'
    return f'{PATIENT}auth.rosauth_secret_file = "{secret}"\n{token}'


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path, settings(tmp_path)) as found:
        yield found


def auth() -> dict[str, object]:
    """Return a valid `auth` op."""
    now = int(time.time())
    members = {"client": "c", "dest": "d", "rand": "r", "t": now, "level": "admin", "end": now + 60}
    text = SECRET + "".join(map(str, members.values()))
    return {"op": "auth", "mac": hashlib.sha512(text.encode()).hexdigest(), **members}


def reason_of_the_end(client: Client) -> str:
    """Return why the server closes a connection."""
    with pytest.raises(ConnectionClosed) as closed:
        client.connection.recv(LONGEST_S)
    assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008
    return closed.value.rcvd.reason


@pytest.mark.parametrize("opcode", [0x81, 0x01])
def test_a_large_message_ends_a_websocket_long_before_its_own_end(server: Served, opcode: int) -> None:
    with ExitStack() as stack:
        client = connected(server, GREEDY, stack)
        client.connection.socket.sendall(frame_head(9_900_000, opcode) + b" " * 3000)
        reason = reason_of_the_end(client)
        assert (
            "9900000 bytes before `auth`" in reason and f"{LIMIT} is the limit (auth.message_bytes)" in reason
        )


def test_unauthenticated_clients_disconnect_nobody(server: Served) -> None:
    with ExitStack() as stack:
        for _ in range(7):
            client = connected(server, GREEDY, stack)
            send_unfinished(client)
            assert "(auth.message_bytes)" in reason_of_the_end(client)


def test_after_auth_messages_may_be_large(server: Served) -> None:
    with server.connect() as client:
        first, second = json.dumps(auth()).encode(), json.dumps(LARGE).encode()
        # Sent together, for one read: the limit must not outlast its first message.
        head = struct.pack(">BBH", 0x81, 0xFE, len(first)) + bytes(4)
        client.connection.socket.sendall(head + first + frame_head(len(second)) + second)
        assert client.call("/rosapi/topic_type", topic="/large")["values"]["type"] == "std_msgs/msg/String"


def test_with_a_token_messages_may_be_large_at_once(server: Served) -> None:
    with ExitStack() as stack:
        client = connected(server, OTHER, stack, headers={"Authorization": f"Bearer {TOKEN}"})
        client.send(**LARGE)
        assert client.call("/rosapi/topic_type", topic="/large")["values"]["type"] == "std_msgs/msg/String"


def rest_of(link: socket.socket) -> bytes:
    """Return what the server sends until it closes the connection."""
    received = b""
    while data := link.recv(65536):
        received += data
    return received


@pytest.mark.parametrize(
    ("mode", "start"),
    [
        ("", b'{"op": "auth", "mac": "' + b"x" * 2 * LIMIT),
        ("bson_only_mode = true\n", struct.pack("<i", 1_000_000) + bytes(2 * LIMIT)),
    ],
)
def test_a_large_message_ends_a_stream(tmp_path: Path, mode: str, start: bytes) -> None:
    with served(tmp_path, mode + settings(tmp_path), url="tcp://127.0.0.1:0") as server:
        host, port = server.host.split(":")
        with socket.create_connection((host, int(port)), LONGEST_S) as link:
            link.sendall(start)
            rest_of(link)
    assert "(auth.message_bytes)" in server.log.read_text()


def test_a_request_without_credentials_has_a_small_body(server: Served) -> None:
    host, port = server.host.split(":")
    head = "POST /api/topics/x HTTP/1.1\r\nHost: localhost\r\nContent-Length: 900000\r\n\r\n"
    with socket.create_connection((host, int(port)), LONGEST_S) as link:
        link.sendall(head.encode() + b"x" * 2 * LIMIT)
        answer = rest_of(link)
    assert answer.startswith(b"HTTP/1.1 401 ") and b"(auth.message_bytes)" in answer


def test_a_request_with_credentials_has_a_large_body(server: Served) -> None:
    body = json.dumps({"data": "x" * 500_000}).encode()
    for address in (GREEDY, OTHER):
        response, connection = request(
            server,
            address,
            "POST",
            "/api/topics/x?type=std_msgs/String",
            body,
            {"Authorization": f"Bearer {TOKEN}"},
        )
        assert response.status == 204, response.read()
        connection.close()


def test_without_authentication_nothing_is_limited(tmp_path: Path) -> None:
    with served(tmp_path, PATIENT) as server, ExitStack() as stack:
        ask_buffer(server, stack)
