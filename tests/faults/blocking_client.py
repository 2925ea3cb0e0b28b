"""A rosbridge client of blocking sockets, which can also misbehave."""

from __future__ import annotations

import json
import socket
import ssl
import struct
import time
from typing import Any

from tests.core.transports.rfc6455.frames import CLOSE, PING, PONG, TEXT, frame, text
from tests.core.transports.rfc6455.handshake import REQUEST

PATIENCE = 60.0
"""Seconds to wait for what must come."""

Message = dict[str, Any]


class Refused(Exception):
    """The server did not open the WebSocket; the text is its answer."""


class BlockingClient:
    """One client; its socket is there for whoever wants to do wrong. In TLS it asks for no certificate."""

    def __init__(self, port: int, *headers: bytes, tls: bool = False) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE)
        if tls:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
            self.socket = context.wrap_socket(self.socket)
        self._data = b""
        try:
            self._shake_hands(headers)
        except BaseException:
            self.socket.close()
            raise

    def _shake_hands(self, headers: tuple[bytes, ...]) -> None:
        extra = b"".join(header + b"\r\n" for header in headers)
        self.socket.sendall(REQUEST[:-2] + extra + b"\r\n")
        while b"\r\n\r\n" not in self._data:
            self._read()
        head, _, self._data = self._data.partition(b"\r\n\r\n")
        if not head.startswith(b"HTTP/1.1 101 "):
            raise Refused((head + b"\r\n\r\n" + self._data).decode())

    def __enter__(self) -> BlockingClient:
        return self

    def __exit__(self, *exception: object) -> None:
        self.socket.close()

    def say(self, op: str, **fields: object) -> None:
        """Send one op."""
        self.socket.sendall(text(json.dumps({"op": op, **fields})))

    def hear(self, op: str, **fields: object) -> Message:
        """The next message of that op with those fields; others are passed over."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            opcode, payload = self.next_frame()
            if opcode == CLOSE:
                raise ConnectionError(f"closed: {payload[2:].decode()}")
            if opcode == PING:
                self.socket.sendall(frame(PONG, payload))
            if opcode == TEXT:
                message: Message = json.loads(payload)
                if message["op"] == op and fields.items() <= message.items():
                    return message
        raise TimeoutError(f"no {op} {fields} in {PATIENCE} s")

    def ending(self) -> tuple[int, str]:
        """Read to the close frame: its code and reason."""
        while True:
            opcode, payload = self.next_frame()
            if opcode == CLOSE:
                return int.from_bytes(payload[:2], "big"), payload[2:].decode()

    def ask_something(self) -> None:
        """Fails when the server does not answer."""
        self.say("call_service", service="/rosapi/get_time", id="are you there", args={})
        assert self.hear("service_response", id="are you there")["result"]

    def reset(self) -> None:
        """Be gone, with a reset."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.socket.close()

    def next_frame(self) -> tuple[int, bytes]:
        """The next frame: its opcode and payload."""
        while True:
            found = self._whole_frame()
            if found is not None:
                return found
            self._read()

    def _whole_frame(self) -> tuple[int, bytes] | None:
        data = self._data
        if len(data) < 2:
            return None
        size, start = data[1], 2
        if size >= 126:
            start = 4 if size == 126 else 10
            size = int.from_bytes(data[2:start], "big")
        if len(data) < start or len(data) < start + size:
            return None
        self._data = data[start + size :]
        return data[0] & 0x0F, data[start : start + size]

    def _read(self) -> None:
        more = self.socket.recv(1 << 16)
        if not more:
            raise ConnectionError("the server has gone")
        self._data += more
