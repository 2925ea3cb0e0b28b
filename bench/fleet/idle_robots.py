"""`python -m bench.fleet.idle_robots`: what robots without clients cost the nodes of a hub.

Robots are connections of one light process, which greet as a robot does and answer pings. Printed are the
time until all nodes list all robots, the memory of a node for each robot that dialled in there, and its CPU
time while nothing happens.
"""

from __future__ import annotations

import argparse
import base64
import os
import resource
import secrets
import selectors
import socket
import sys
import time
import urllib.request
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Final

from bench.network.hub import Part, started
from bench.traffic.wire import BINARY, masked
from rwt.extensions.hub.uplink.frames import (
    HEADER,
    SUBPROTOCOL,
    Hello,
    Kind,
    decode_frame,
    encode_hello,
)

AT_ONCE: Final = 100
"""Robots that are dialling in at a time, for each node."""
_RECEIVED_BYTES: Final = 4096


class Robots:
    """Connections of robots, which answer pings.

    Attributes:
        greeted: robots that the hub has greeted.
    """

    def __init__(self) -> None:
        self.greeted = 0
        self._selector = selectors.DefaultSelector()
        self._begun = 0
        self._rest: dict[int, bytes] = {}

    def dial(self, url: str, name: str) -> None:
        """Begin to dial in."""
        host, _, port = url.removeprefix("ws://").partition(":")
        link = socket.create_connection((host, int(port)), timeout=60)
        key = base64.b64encode(os.urandom(16)).decode()
        link.sendall(
            f"GET /robots/{name} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n"
            f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\nrwt-instance: {secrets.token_hex(8)}\r\n\r\n".encode()
        )
        link.setblocking(False)
        self._selector.register(link, selectors.EVENT_READ)
        self._rest[link.fileno()] = b""
        self._begun += 1

    @property
    def pending(self) -> int:
        """Robots that have not been greeted."""
        return self._begun - self.greeted

    def serve(self, seconds: float) -> None:
        """Read and answer for so long."""
        until = time.monotonic() + seconds
        while True:
            for key, _ in self._selector.select(max(0.0, min(0.05, until - time.monotonic()))):
                assert isinstance(key.fileobj, socket.socket)
                self._read(key.fileobj)
            if time.monotonic() >= until:
                return

    def _read(self, link: socket.socket) -> None:
        data = link.recv(_RECEIVED_BYTES)
        if not data:
            raise ConnectionError("a robot was cut off")
        rest = self._rest[link.fileno()] + data
        head, end, behind = rest.partition(b"\r\n\r\n") if rest.startswith(b"HTTP") else (b"", b"\r", rest)
        if head:
            if not end:
                self._rest[link.fileno()] = rest
                return
            assert b" 101 " in head, head
            link.sendall(masked(encode_hello(Hello("", 0, "bench")), BINARY))
        self._rest[link.fileno()] = self._answered(link, behind)

    def _answered(self, link: socket.socket, data: bytes) -> bytes:
        while len(data) >= 2:
            size = data[1] if data[1] < 126 else int.from_bytes(data[2:4], "big")
            begin = 2 if data[1] < 126 else 4
            if len(data) < begin + size:
                break
            frame, data = data[begin : begin + size], data[begin + size :]
            kind = frame[0]
            if kind == Kind.HELLO:
                decode_frame(frame)
                self.greeted += 1
            elif kind == Kind.PING:
                link.sendall(masked(HEADER.pack(Kind.PONG, 0, 0) + frame[HEADER.size :], BINARY))
        return data


def resident(pid: int) -> int:
    """Return the resident bytes of a process."""
    with open(f"/proc/{pid}/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def listed(nodes: Sequence[Part], count: int) -> Iterator[bool]:
    """Yield for each node whether it lists so many robots."""
    for node in nodes:
        with urllib.request.urlopen(node.url.replace("ws://", "http://") + "/robots", timeout=60) as page:
            yield page.read().count(b'"path"') >= count


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.fleet.idle_robots", description=__doc__)
    parser.add_argument("--robots", type=int, default=3000, metavar="N", help="of all nodes (default 3000)")
    parser.add_argument("--nodes", type=int, default=3, metavar="N", help="default 3")
    parser.add_argument("--seconds", type=float, default=20.0, help="of idle time (default 20)")
    options = parser.parse_args(argv)
    with ExitStack() as stack:
        nodes, robots = started(options.nodes, stack), Robots()
        time.sleep(2.0)
        before = [resident(node.pid) for node in nodes]
        cpu_before, began = [node.ask()[0] for node in nodes], time.monotonic()
        waiting = deque(range(options.robots))
        while waiting or robots.pending:
            while waiting and robots.pending < AT_ONCE * len(nodes):
                number = waiting.popleft()
                robots.dial(nodes[number % len(nodes)].url, f"robot{number}")
            robots.serve(0.001)
        greeted = time.monotonic() - began
        while not all(listed(nodes, options.robots)):
            robots.serve(0.05)
        seconds, cpu = time.monotonic() - began, [node.ask()[0] for node in nodes]
        used = sum(cpu) - sum(cpu_before)
        own = options.robots / len(nodes)
        growth = [(resident(node.pid) - old) / own / 1e3 for node, old in zip(nodes, before, strict=True)]
        print(
            f"{options.robots} robots on {len(nodes)} nodes: greeted in {greeted:.1f} s, listed by all in",
            end="",
        )
        print(f" {seconds:.1f} s, {used / options.robots * 1e3:.2f} ms of CPU of the nodes for each")
        print(f"memory for each robot of a node: {max(growth):.1f} kB, with the directory of all")
        robots.serve(options.seconds)
        idle = [node.ask()[0] - old for node, old in zip(nodes, cpu, strict=True)]
        print(f"CPU of a node while idle: {max(idle) / options.seconds * 100:.1f} % of a core")
    return 0


if __name__ == "__main__":
    sys.exit(main())
