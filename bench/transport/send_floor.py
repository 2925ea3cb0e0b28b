"""`python -m bench.transport.send_floor`: what the kernel alone takes to send a frame to many connections.

A bare loop over connected sockets, with a reader in another process: no event loop, no protocol, no looking.
Whatever a server in Python does for a delivery comes on top of one such call, or shares it with other frames.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import selectors
import socket
import time
from collections.abc import Sequence
from statistics import median

CONNECTIONS = 100
FRAME = 145
"""Bytes of a small Twist to a client, its header included."""


def read_all(address: tuple[str, int], connections: int) -> None:
    """Connect so often, and read until everybody has closed."""
    with contextlib.ExitStack() as stack, selectors.DefaultSelector() as selector:
        for _ in range(connections):
            reader = stack.enter_context(socket.create_connection(address))
            reader.setblocking(False)
            selector.register(reader, selectors.EVENT_READ)
        buffer = bytearray(1 << 20)
        while selector.get_map():
            time.sleep(0.002)
            for key, _ in selector.select():
                assert isinstance(key.fileobj, socket.socket)
                if not key.fileobj.recv_into(buffer):
                    selector.unregister(key.fileobj)


def measure(sockets: Sequence[socket.socket], data: bytes, turns: int) -> float:
    """Microseconds of CPU for one call."""
    begin = time.process_time()
    for _ in range(turns):
        for each in sockets:
            with contextlib.suppress(BlockingIOError):
                each.send(data)
        time.sleep(0.001)
    return (time.process_time() - begin) / turns / len(sockets) * 1e6


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.transport.send_floor", description=__doc__)
    parser.add_argument("--connections", type=int, default=CONNECTIONS, help="default 100")
    parser.add_argument("--turns", type=int, default=200, help="of each round (default 200)")
    options = parser.parse_args(argv)
    with socket.create_server(("127.0.0.1", 0), backlog=512) as listening:
        child = os.fork()
        if not child:
            read_all(listening.getsockname(), options.connections)
            os._exit(0)
        sockets = [listening.accept()[0] for _ in range(options.connections)]
    for each in sockets:
        each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        each.setblocking(False)
    for frames in (1, 8, 64):
        data = b"x" * FRAME * frames
        taken = median(measure(sockets, data, options.turns) for _ in range(5))
        print(f"{frames} frames a call: {taken:.2f} µs, {taken / frames / 100:.4f} s for 10,000 deliveries")
    for each in sockets:
        each.close()
    os.waitpid(child, 0)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
