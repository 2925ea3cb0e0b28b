"""A bare loop over sockets that does no more than move bytes: for each large frame that one client sends,
every other client gets the same prepared frame.

Nothing is unmasked, looked at or copied within the process. What this takes is what no relay of WebSockets on
the same kernel can do without, in whatever language. It shakes hands as WebSocket does, so that the load of
the bench speaks to it as to every other server; what it sends is the first message of `messages.strings()`.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import re
import selectors
import socket

from bench.traffic.messages import Stream, strings

BUFFER = 1 << 21
LARGE = 1 << 16
"""Shorter frames are not messages of the load, and are not forwarded."""
ACCEPTED = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
"""Constant that follows the key in the hash of RFC 6455, section 4.2.2."""
CLOSE = 0x8


def prepared(stream: Stream) -> bytes:
    """The first message of a stream as a frame from a server."""
    text = stream.publish(stream.messages[0])
    return b"\x81\x7f" + len(text).to_bytes(8, "big") + text


class Client:
    """One connection: how far it is in the frame that it sends, and what it has not taken yet."""

    def __init__(self, sock: socket.socket) -> None:
        self.sock = sock
        self.unsent: list[memoryview] = []
        self._head = b""
        self._skip = 0
        self._is_large = False

    def shake_hands(self) -> None:
        """Answer the request, which is read as it comes."""
        request = b""
        while b"\r\n\r\n" not in request:
            request += self.sock.recv(4096)
        key = re.search(rb"(?i)sec-websocket-key: *(\S+)", request)
        assert key is not None
        accept = base64.b64encode(hashlib.sha1(key[1] + ACCEPTED).digest())
        head = b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        self.sock.sendall(head + b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n")
        self.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.sock.setblocking(False)

    def take(self, data: memoryview) -> int:
        """Walk over what was received; how many large frames end in it, or -1 where the client closes."""
        ended = 0
        while len(data):
            if self._skip:
                count = min(self._skip, len(data))
                self._skip -= count
                data = data[count:]
                ended += self._is_large and not self._skip
                continue
            missing = self._missing()
            self._head += data[:missing]
            data = data[missing:]
            if not self._missing():
                if self._head[0] & 0x0F == CLOSE:
                    return -1
                short = self._head[1] & 0x7F
                size = short if short < 126 else int.from_bytes(self._head[2:-4], "big")
                self._skip, self._head, self._is_large = size, b"", size >= LARGE
        return ended

    def _missing(self) -> int:
        """Return the number of bytes missing of a masked frame's head."""
        if len(self._head) < 2:
            return 2 - len(self._head)
        return {126: 8, 127: 14}.get(self._head[1] & 0x7F, 6) - len(self._head)

    def send(self, data: memoryview) -> bool:
        """Send as much as the kernel takes; whether that is all."""
        if not self.unsent:
            with contextlib.suppress(BlockingIOError):
                data = data[self.sock.send(data) :]
        if len(data):
            self.unsent.append(data)
        return not self.unsent

    def go_on(self) -> bool:
        """Send what has waited; whether that is all."""
        waiting, self.unsent = self.unsent, []
        for data in waiting:
            self.send(data)
        return not self.unsent


def main() -> None:
    frame = memoryview(prepared(strings()))
    buffer = bytearray(BUFFER)
    view = memoryview(buffer)
    selector = selectors.DefaultSelector()
    clients: list[Client] = []
    with socket.create_server(("127.0.0.1", 0), backlog=128) as listening:
        selector.register(listening, selectors.EVENT_READ)
        print(f"listening on ws://127.0.0.1:{listening.getsockname()[1]}", flush=True)
        while True:
            for key, events in selector.select():
                client = key.data
                if client is None:
                    client = Client(listening.accept()[0])
                    client.shake_hands()
                    clients.append(client)
                    selector.register(client.sock, selectors.EVENT_READ, client)
                    continue
                if events & selectors.EVENT_WRITE and client.go_on():
                    selector.modify(client.sock, selectors.EVENT_READ, client)
                if not events & selectors.EVENT_READ:
                    continue
                size = client.sock.recv_into(buffer)
                ended = client.take(view[:size]) if size else -1
                if ended < 0:
                    selector.unregister(client.sock)
                    client.sock.close()
                    clients.remove(client)
                for other in clients * max(ended, 0):
                    if other is not client and not other.send(frame):
                        selector.modify(other.sock, selectors.EVENT_READ | selectors.EVENT_WRITE, other)


if __name__ == "__main__":
    main()
