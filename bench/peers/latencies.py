"""Latencies of a topic at one reader: `python -m bench.peers.latencies URL|rclpy TYPE`.

It writes a list at its end: the nanoseconds between the stamp of each message and its arrival. A publisher
stamps a message in its header, a Twist in `linear.x`; both by the clock of `time.monotonic_ns`.
"""

from __future__ import annotations

import importlib
import json
import re
import signal
import socket
import sys
import threading
import time
from typing import Any, Final

_STAMP: Final = re.compile(rb'"sec": ?(\d+), ?"nanosec": ?(\d+)')
_SPEED: Final = re.compile(rb'"x": ?([0-9.e+]+)')
#: Length of a WebSocket frame from which two or eight bytes have it.
_LONG: Final = 126
#: Bytes in which the stamp of a message is.
_HEAD_BYTES: Final = 400


def _of_text(data: bytes) -> int:
    found = _STAMP.search(data)
    if found is not None:
        return int(found[1]) * 10**9 + int(found[2])
    speed = _SPEED.search(data)
    return 0 if speed is None else int(float(speed[1]))


def _of_message(message: Any) -> int:
    if hasattr(message, "header"):
        return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)
    return int(message.linear.x)


def read_rosbridge(url: str, type_name: str, latencies: list[int]) -> None:
    """Note the latencies of a server's messages until the connection ends, at little cost for itself."""
    host, _, port = url.removeprefix("ws://").rstrip("/").rpartition(":")
    with socket.create_connection((host, int(port))) as connection:
        connection.sendall(
            b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        received = bytearray()
        while b"\r\n\r\n" not in received:
            received += connection.recv(1)
        request = {"op": "subscribe", "topic": "/measured", "type": type_name}
        text = json.dumps(request).encode()
        connection.sendall(b"\x81" + bytes([0x80 | len(text)]) + bytes(4) + text)  # A mask of zeros.
        buffer = memoryview(bytearray(2**22))
        while True:
            size = _read_frame(connection, buffer)
            latencies.append(time.monotonic_ns() - _of_text(bytes(buffer[: min(size, _HEAD_BYTES)])))


def _read_frame(connection: socket.socket, buffer: memoryview) -> int:
    """Read a whole frame of a server, which is unmasked; return the size of its payload."""
    _read(connection, buffer[:2])
    size = buffer[1]
    if size >= _LONG:
        length = 2 if size == _LONG else 8
        _read(connection, buffer[:length])
        size = int.from_bytes(buffer[:length])
    _read(connection, buffer[:size])
    return size


def _read(connection: socket.socket, target: memoryview) -> None:
    while target:
        count = connection.recv_into(target)
        if not count:
            raise EOFError("the server has closed the connection")
        target = target[count:]


def read_rclpy(type_name: str, latencies: list[int]) -> None:
    """Note the latencies of the messages of a bare subscription."""
    import rclpy

    package, _, name = type_name.split("/")
    rclpy.init()
    node = rclpy.create_node("latencies")
    node.create_subscription(
        getattr(importlib.import_module(f"{package}.msg"), name),
        "/measured",
        lambda message: latencies.append(time.monotonic_ns() - _of_message(message)),
        10,
    )
    rclpy.spin(node)


def main() -> None:
    """Read until the standard input ends; then write the latencies since its last line."""
    source, type_name = sys.argv[1:]
    latencies: list[int] = []
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def read() -> None:
        if source == "rclpy":
            read_rclpy(type_name, latencies)
        else:
            read_rosbridge(source, type_name, latencies)

    threading.Thread(target=read, daemon=True).start()
    for _ in sys.stdin:
        latencies.clear()
    print(json.dumps(latencies), flush=True)


if __name__ == "__main__":
    main()
