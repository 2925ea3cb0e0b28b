"""A bare relay of a ROS 1 topic on asyncio: received bytes are written to a TCP connection as they are.

Each chunk costs a wake-up of the event loop, `recv_into` and `send`. Nothing is split into messages, decoded
or framed, so this is the minimum for a server on asyncio.

Arguments: host and port of the publisher, and the topic.
"""

from __future__ import annotations

import asyncio
import select
import socket
import sys
from contextlib import suppress
from functools import partial

BUFFER_BYTES = 1 << 20


def connection_header(topic: str) -> bytes:
    """Return the header of a subscriber that accepts every type."""
    fields = (b"callerid=/relay", b"md5sum=*", b"type=*", b"tcp_nodelay=1", b"topic=" + topic.encode())
    body = b"".join(len(field).to_bytes(4, "little") + field for field in fields)
    return len(body).to_bytes(4, "little") + body


def subscribe(host: str, port: int, topic: str) -> socket.socket:
    """Connect to the publisher, and read its header."""
    publisher = socket.create_connection((host, port))
    publisher.sendall(connection_header(topic))
    size = int.from_bytes(publisher.recv(4, socket.MSG_WAITALL), "little")
    publisher.recv(size, socket.MSG_WAITALL)
    return publisher


async def main(host: str, port: int, topic: str) -> None:
    loop = asyncio.get_running_loop()
    buffer = memoryview(bytearray(BUFFER_BYTES))

    def forward(publisher: socket.socket, client: socket.socket) -> None:
        size = publisher.recv_into(buffer)
        sent = 0
        while sent < size:
            try:
                sent += client.send(buffer[sent:size])
            except BlockingIOError:
                select.select((), (client,), ())  # Nothing else is to be done meanwhile.
            except OSError:
                return  # The client is leaving.

    with socket.create_server(("127.0.0.1", 0)) as listening:
        print(f"listening on ws://127.0.0.1:{listening.getsockname()[1]}", flush=True)
        listening.setblocking(False)
        while True:
            client, _ = await loop.sock_accept(listening)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with client, subscribe(host, port, topic) as publisher:
                publisher.setblocking(False)
                loop.add_reader(publisher, partial(forward, publisher, client))
                try:
                    with suppress(OSError):
                        await loop.sock_recv(client, 1)  # Until the client closes.
                finally:
                    loop.remove_reader(publisher)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), sys.argv[3]))
