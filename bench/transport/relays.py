"""Cost of the transport alone: the same relay on listen() and on websockets' asyncio server.

Both forward every message to all other connections without looking at it. The load comes from another
process, which speaks just enough WebSocket to be cheaper than either server. Run with ``python -m
bench.transport.relays``.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import resource
import secrets
import socket
import statistics
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import ClassVar

from rwt_protocol.frames import Frame
from rwt_transports import listen
from rwt_transports.endpoint import PeerInfo, Sink

TWIST = (
    b'{"op":"publish","topic":"/cmd","msg":{"linear":{"x":0.5,"y":0,"z":0},"angular":{"x":0,"y":0,"z":0.1}}}'
)


# -- the two servers -------------------------------------------------------------------------------------


class Relay:
    """Forwards to everyone else."""

    peers: ClassVar[set[Relay]] = set()

    def __init__(self, sink: Sink, _peer: PeerInfo) -> None:
        self.sink = sink
        self.peers.add(self)

    def receive(self, data: bytes, binary: bool) -> None:
        frame = Frame(data, binary=binary)
        for peer in self.peers:
            if peer is not self:
                peer.sink.send(frame)

    def closed(self, _code: int, _reason: str) -> None:
        self.peers.discard(self)


async def serve_ours() -> None:
    async with listen("ws://127.0.0.1:0", Relay) as listener:
        print(listener.url.rpartition(":")[2], flush=True)
        await asyncio.to_thread(sys.stdin.readline)


async def serve_websockets() -> None:
    from websockets.asyncio.server import ServerConnection, broadcast, serve
    from websockets.exceptions import ConnectionClosed

    peers: set[ServerConnection] = set()

    async def relay(peer: ServerConnection) -> None:
        peers.add(peer)
        try:
            async for message in peer:
                broadcast(peers - {peer}, message)
        except ConnectionClosed:
            return
        finally:
            peers.discard(peer)

    async with serve(relay, "127.0.0.1", 0, compression=None, max_size=None) as server:
        print(next(iter(server.sockets)).getsockname()[1], flush=True)
        await asyncio.to_thread(sys.stdin.readline)


SERVERS = {"ours": serve_ours, "websockets": serve_websockets}


# -- the load --------------------------------------------------------------------------------------------


def masked(payload: bytes) -> bytes:
    size = len(payload)
    head = bytes([0x81])
    if size < 126:
        head += bytes([0x80 | size])
    elif size < 65536:
        head += struct.pack("!BH", 0xFE, size)
    else:
        head += struct.pack("!BQ", 0xFF, size)
    from websockets.speedups import apply_mask

    key = secrets.token_bytes(4)
    return head + key + apply_mask(payload, key)


def framed_size(size: int) -> int:
    return size + (2 if size < 126 else 4 if size < 65536 else 10)


def connect(port: int) -> socket.socket:
    peer = socket.create_connection(("127.0.0.1", port))
    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    key = "x3JJHMbDL1EzLkh9GBhXDw=="
    peer.sendall(
        f"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    answer = b""
    while not answer.endswith(b"\r\n\r\n"):
        answer += peer.recv(1)
    return peer


def flood(port: int, payload: bytes, count: int, readers: int) -> float:
    """Seconds from the first message sent to the last byte read by every reader."""
    writer = connect(port)
    sinks = [connect(port) for _ in range(readers)]
    expected = framed_size(len(payload)) * count
    one = masked(payload)
    batch = max(1, min(count, 65536 // len(one)))
    started = time.perf_counter()

    def write() -> None:
        for at in range(0, count, batch):
            writer.sendall(one * min(batch, count - at))

    thread = threading.Thread(target=write)
    thread.start()
    drain(sinks, expected)
    elapsed = time.perf_counter() - started
    thread.join()
    for each in (writer, *sinks):
        each.close()
    return elapsed


def drain(sinks: list[socket.socket], expected: int) -> None:
    import select

    left = {each.fileno(): (each, expected) for each in sinks}
    poll = select.epoll()
    for each in sinks:
        poll.register(each, select.EPOLLIN)
    room = memoryview(bytearray(1 << 20))
    while left:
        for number, _ in poll.poll():
            peer, missing = left[number]
            missing -= peer.recv_into(room)
            left[number] = (peer, missing)
            if missing <= 0:
                poll.unregister(peer)
                del left[number]


def latency(port: int, payload: bytes, count: int) -> float:
    """Median microseconds from a message sent to the same message read by the one other connection."""
    with closing(connect(port)) as writer, closing(connect(port)) as reader:
        size = framed_size(len(payload))
        times = []
        for _ in range(count):
            data = masked(payload)
            started = time.perf_counter()
            writer.sendall(data)
            missing = size
            while missing:
                missing -= len(reader.recv(missing))
            times.append(time.perf_counter() - started)
            time.sleep(0.002)
    return statistics.median(times) * 1e6


# -- the comparison --------------------------------------------------------------------------------------


@contextmanager
def server(name: str) -> Iterator[tuple[int, int]]:
    process = subprocess.Popen(
        [sys.executable, os.path.abspath(__file__), "--serve", name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None and process.stdout is not None
    try:
        yield int(process.stdout.readline()), process.pid
    finally:
        process.stdin.close()
        process.wait(10)
        process.stdout.close()


def cpu_seconds(pid: int) -> float:
    with open(f"/proc/{pid}/stat") as stat:
        fields = stat.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(name: str, rounds: int, only: str) -> dict[str, float]:
    cases = {
        "1-1 small": (TWIST, 60_000, 1),
        "1-100 small": (TWIST, 3_000, 100),
        "1 MB": (b'"' + b"x" * 1_000_000 + b'"', 300, 1),
        "1.2 MB": (b'"' + b"A" * 1_228_800 + b'"', 250, 1),
    }
    results: dict[str, float] = {}
    with server(name) as (port, pid):
        flood(port, TWIST, 2000, 2)
        for case, (payload, count, readers) in cases.items():
            if only not in case:
                continue
            best = float("inf")
            cpu = float("inf")
            for _ in range(rounds):
                before = cpu_seconds(pid)
                best = min(best, flood(port, payload, count, readers))
                cpu = min(cpu, cpu_seconds(pid) - before)
            results[f"{case}: deliveries/s"] = count * readers / best
            results[f"{case}: us CPU a delivery"] = cpu / (count * readers) * 1e6
        results["p50 us"] = latency(port, TWIST, 400)
        with open(f"/proc/{pid}/status") as status:
            resident = next(line for line in status if line.startswith("VmRSS"))
        results["MB"] = int(resident.split()[1]) / 1024
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--serve", choices=SERVERS)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", help="run only the cases whose name contains this")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, 4096))
    if options.serve:
        asyncio.run(SERVERS[options.serve]())
        return
    ours = measure("ours", options.rounds, options.only or "")
    theirs = measure("websockets", options.rounds, options.only or "")
    if options.json:
        print(json.dumps({"ours": ours, "websockets": theirs}))
        return
    print(f"{'':36}{'ours':>12}{'websockets':>12}{'ratio':>8}")
    for row, value in ours.items():
        print(f"{row:36}{value:12.1f}{theirs[row]:12.1f}{value / theirs[row]:8.2f}")


if __name__ == "__main__":
    main()
