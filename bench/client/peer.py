"""The other side of the client benchmark: a server that only sends, or only counts, as fast as it can.

It says `listening on ws://127.0.0.1:PORT`. The path of a connection says what to do:

`/receive/CASE/COUNT`    once something was subscribed to, send COUNT messages, in CBOR if that was asked for
`/publish/COUNT`         once COUNT messages were published, send one on `/done`
"""

from __future__ import annotations

import base64
import hashlib
import re
import socket
import threading

from rwt_interfaces import JAZZY, Payload, Registry


def _vector(first: float) -> dict[str, object]:
    return {"x": first, "y": first / 3, "z": first / 7}


_POSE = {"position": _vector(1.25), "orientation": {**_vector(0.1), "w": 0.98}}
_TWIST = {"linear": _vector(0.25), "angular": _vector(-0.5)}
_COVARIANCE = [number / 1000 for number in range(36)]
_HEADER = {"stamp": {"sec": 1_700_000_000, "nanosec": 123_456_789}, "frame_id": "odom"}

CASES: dict[str, tuple[str, dict[str, object]]] = {
    "String": ("std_msgs/String", {"data": "hello, robot"}),
    "Twist": ("geometry_msgs/Twist", dict(_TWIST)),
    "Odometry": (
        "nav_msgs/Odometry",
        {
            "header": _HEADER,
            "child_frame_id": "base_link",
            "pose": {"pose": _POSE, "covariance": _COVARIANCE},
            "twist": {"twist": _TWIST, "covariance": _COVARIANCE},
        },
    ),
    "Image": (
        "sensor_msgs/Image",
        {"width": 640, "height": 480, "step": 1920, "encoding": "rgb8", "data": bytes(range(256)) * 3600},
    ),
}
"""Messages by name of the case: type and complete message."""

_GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
_BURST_BYTES = 64 * 1024
_READ_BYTES = 1 << 20


def framed(payload: bytes, binary: bool) -> bytes:
    """One WebSocket frame from a server (RFC 6455 section 5.2)."""
    first = bytes((0x82 if binary else 0x81,))
    size = len(payload)
    if size < 126:
        return first + bytes((size,)) + payload
    if size < 1 << 16:
        return first + b"\x7e" + size.to_bytes(2, "big") + payload
    return first + b"\x7f" + size.to_bytes(8, "big") + payload


def messages() -> dict[tuple[str, bool], bytes]:
    """Each case's frame, by its name and whether it is CBOR."""
    registry = Registry(JAZZY)
    found = {}
    for name, (type_name, value) in CASES.items():
        payload = Payload.from_value(registry.message(type_name), value)
        text = b'{"op":"publish","topic":"/bench","msg":' + bytes(payload.json()) + b"}"
        found[name, False] = framed(text, False)
        head = b"\xa3\x62op\x67publish\x65topic\x66/bench\x63msg"
        found[name, True] = framed(head + payload.cbor(), True)
    return found


def shake_hands(connection: socket.socket) -> str:
    """Answer the upgrade; gives the path that was asked for."""
    head = b""
    while b"\r\n\r\n" not in head:
        head += connection.recv(4096)
    key = re.search(rb"(?i)sec-websocket-key: *(\S+)", head)
    path = head.split(b" ", 2)[1].decode()
    accept = base64.b64encode(hashlib.sha1((key[1] if key else b"") + _GUID).digest())
    connection.sendall(
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n"
    )
    return path


class Frames:
    """The frames that a client sends, unmasked one by one."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._data = bytearray()
        self._at = 0

    def next(self) -> bytes:
        """The payload of the next frame."""
        size, start = self._header()
        self._need(start + size)
        key = int.from_bytes((self._data[start - 4 : start] * (size // 4 + 1))[:size], "little")
        payload = int.from_bytes(self._data[start : start + size], "little") ^ key
        self._at = start + size
        return payload.to_bytes(size, "little")

    def skip(self, count: int) -> None:
        """Pass over the next frames, and quickly: the client must be what is measured."""
        while count:
            data, at, end = self._data, self._at, len(self._data) - 14
            while count and at < end:
                size = data[at + 1] & 0x7F
                if size < 126:
                    at += 6 + size
                elif size == 126:
                    at += 8 + (data[at + 2] << 8) + data[at + 3]
                else:
                    at += 14 + int.from_bytes(data[at + 2 : at + 10], "big")
                count -= 1
            self._at = at
            if count:
                self.next()
                count -= 1
            del self._data[: self._at]
            self._at = 0

    def _header(self) -> tuple[int, int]:
        """The size of the next frame's payload, and where it begins."""
        at = self._at
        self._need(at + 2)
        size = self._data[at + 1] & 0x7F
        if size < 126:
            return size, at + 6
        width = 2 if size == 126 else 8
        self._need(at + 2 + width)
        return int.from_bytes(self._data[at + 2 : at + 2 + width], "big"), at + 6 + width

    def _need(self, end: int) -> None:
        while len(self._data) < end:
            read = self._connection.recv(_READ_BYTES)
            if not read:
                raise ConnectionError
            self._data += read


def receive_case(connection: socket.socket, frames: Frames, case: str, count: int) -> None:
    """Send messages once something was subscribed to."""
    while b'"subscribe"' not in (op := frames.next()):
        pass
    frame = MESSAGES[case, b'"cbor"' in op]
    at_once = max(1, _BURST_BYTES // len(frame))
    burst = frame * at_once
    for _ in range(count // at_once):
        connection.sendall(burst)
    connection.sendall(frame * (count % at_once))
    # The client hangs up when it has them all.
    while connection.recv(_READ_BYTES):
        pass


def publish_case(connection: socket.socket, frames: Frames, count: int) -> None:
    """Say when everything that was published has come."""
    while b'"publish"' not in frames.next():
        pass
    frames.skip(count - 1)
    connection.sendall(framed(b'{"op":"publish","topic":"/done","msg":{"data":"done"}}', False))
    while connection.recv(_READ_BYTES):
        pass


def serve(connection: socket.socket) -> None:
    """Do what the path of one connection asks for."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    try:
        _, what, *rest = shake_hands(connection).split("/")
        frames = Frames(connection)
        if what == "receive":
            receive_case(connection, frames, rest[0], int(rest[1]))
        else:
            publish_case(connection, frames, int(rest[0]))
    except OSError:
        return
    finally:
        connection.close()


MESSAGES = messages()


def main() -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    print(f"listening on ws://127.0.0.1:{listener.getsockname()[1]}", flush=True)
    while True:
        connection, _ = listener.accept()
        threading.Thread(target=serve, args=(connection,), daemon=True).start()


if __name__ == "__main__":
    main()
