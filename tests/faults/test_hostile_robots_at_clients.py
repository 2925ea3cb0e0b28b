"""Robots that send compression bombs to a client: the command ends with a reason and keeps little memory."""

from __future__ import annotations

import base64
import json
import socket
import struct
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from websockets.sync.server import ServerConnection, serve
from websockets.utils import accept_key

from tests.core.transports.rfc6455.frames import TEXT, frame
from tests.faults.limited import run_command

MOST_GROWN = 128 * 2**20
SIDE = 20_000
"""Pixels of a side: 1.2 GB unpacked, from 1.2 MB."""


@contextmanager
def _robot(handle: Callable[[ServerConnection], None], **options: Any) -> Iterator[str]:
    with serve(handle, "127.0.0.1", 0, **options) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()
        thread.join()


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _png_bomb() -> str:
    packer = zlib.compressobj(9)
    row = bytes(1 + 3 * SIDE)
    data = b"".join(packer.compress(row) for _ in range(SIDE)) + packer.flush()
    head = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 2, 0, 0, 0)
    content = b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", head) + _chunk(b"IDAT", data) + _chunk(b"IEND", b"")
    return json.dumps({"op": "png", "data": base64.b64encode(content).decode()})


def test_a_png_bomb_is_not_unpacked_by_a_client() -> None:
    bomb = _png_bomb()

    def handle(wire: ServerConnection) -> None:
        for text in wire:
            if json.loads(text)["op"] == "subscribe":
                wire.send(bomb)

    with _robot(handle) as url:
        words = ["topic", "echo", "--once", "/x", "std_msgs/msg/String", "--url", url, "--timeout", "2"]
        ended = run_command(words)
    assert ended.code in (1, 3, 4), ended.output[-500:]
    assert "Traceback" not in ended.output
    assert ended.grown_bytes < MOST_GROWN


def test_a_robot_cannot_compress_to_a_client_that_did_not_ask() -> None:
    def handle(wire: ServerConnection) -> None:
        for _ in wire:
            wire.send("x" * 2**24)

    with _robot(handle, compression="deflate") as url:
        ended = run_command(["topic", "list", "--url", url, "--timeout", "2"])
    assert ended.code in (1, 3, 4), ended.output[-500:]
    assert "Traceback" not in ended.output
    assert ended.grown_bytes < MOST_GROWN


@pytest.mark.parametrize("agreed", ["", "Sec-WebSocket-Extensions: permessage-deflate\r\n"])
def test_a_compression_bomb_of_a_robot_is_not_inflated(agreed: str) -> None:
    """A client offers no compression, so a robot cannot agree on it, or use it without agreement."""
    packer = zlib.compressobj(9, wbits=-15)
    bomb = packer.compress(bytes(2**28)) + packer.flush(zlib.Z_SYNC_FLUSH)[:-4]

    def answer(connection: socket.socket) -> None:
        head = b""
        while b"\r\n\r\n" not in head and (data := connection.recv(4096)):
            head += data
        key = next(line[19:] for line in head.decode().split("\r\n") if line.startswith("Sec-WebSocket-Key"))
        connection.sendall(
            "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Accept: {accept_key(key)}\r\n{agreed}\r\n".encode()
        )
        connection.sendall(frame(TEXT, bomb, reserved=4, masked=False))
        while connection.recv(4096):
            pass

    def robot() -> None:
        while True:
            with suppress(OSError), listener.accept()[0] as connection:
                answer(connection)
            if listener.fileno() < 0:
                return

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=robot, daemon=True).start()
        url = f"ws://127.0.0.1:{listener.getsockname()[1]}"
        ended = run_command(["topic", "list", "--url", url, "--timeout", "2"])
    assert ended.code in (1, 3, 4), ended.output[-500:]
    assert "Traceback" not in ended.output
    assert ended.grown_bytes < MOST_GROWN
