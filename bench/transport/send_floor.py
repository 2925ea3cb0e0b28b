"""`python -m bench.transport.send_floor`: what the kernel alone takes to send a frame to many connections.

A bare loop over connected sockets, with a reader in another process: no event loop, no protocol, no looking.
Whatever a server in Python does for a delivery comes on top of one such call, or shares it with other frames.

With `--frame` it is a frame of 1 MB on its whole way, from one client through a server to one and to ten:
through a loop that looks at nothing (`bench/peers/bare_loop.py`), the bare relay, and this server in JSON
and CBOR, in turns. The kernel's share is that of a server's CPU time; page faults tell whether its allocator
gives memory back after each message, which with glibc depends on where its blocks happen to lie.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import selectors
import socket
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

from bench.traffic import load, messages
from bench.traffic.load import Throughput, Window
from bench.traffic.processes import Server

CONNECTIONS = 100
FRAME = 145
"""Bytes of a small Twist to a client, its header included."""


PEERS: Final = Path(__file__).parent.parent / "peers"
WAYS: Final = (
    ("bare loop", ("-m", "bench.peers.bare_loop"), "none"),
    ("relay", (str(PEERS / "relay.py"),), "none"),
    ("this server, JSON", (str(PEERS / "server.py"),), "none"),
    ("this server, CBOR", (str(PEERS / "server.py"),), "cbor"),
)
"""Each server, and the encoding that its subscribers ask for."""
RELAY = "relay"
ROUNDS, SECONDS = 5, 1.0


@dataclass(frozen=True, slots=True)
class Way:
    """Cost of a frame of 1 MB through one server.

    Attributes:
        rate: deliveries a second.
        cpu: microseconds of the server's CPU for a delivery.
        kernel: the kernel's share of that, 0 to 1.
        faults: pages that the server was given for a delivery.
    """

    rate: float
    cpu: float
    kernel: float
    faults: float


def _usage(pid: int) -> tuple[int, int, int]:
    """Clock ticks of a process outside and in the kernel, and its minor page faults."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]), int(fields[12]), int(fields[7])


def way_through(server: Server, compression: str, subscribers: int, seconds: float) -> Way:
    """One load, as the bench has it."""
    before = _usage(server.pid)
    found = load.fan_out(server, messages.strings(), subscribers, Window(2, 1), seconds, (compression,))
    user, kernel, faults = (now - then for now, then in zip(_usage(server.pid), before, strict=True))
    return _way(found, user, kernel, faults)


def _way(found: Throughput, user: int, kernel: int, faults: int) -> Way:
    # Ticks and faults are of the warm-up and the probes, too, during which as much is done for a delivery.
    share = kernel / max(user + kernel, 1)
    ticks = os.sysconf("SC_CLK_TCK")
    deliveries = (user + kernel) / ticks / found.cpu * found.count
    return Way(found.rate, found.cpu / found.count * 1e6, share, faults / max(deliveries, 1))


def large_frames(rounds: int, seconds: float) -> str:
    """The table for large frames: medians over the rounds, and of the ratios within a round."""
    heads = ("deliveries/s", "of relay", "µs of CPU", "of relay", "kernel", "faults")
    lines = [f"{'frame of 1 MB':<24}" + "".join(f"{head:>13}" for head in heads)]
    with contextlib.ExitStack() as stack:
        servers: dict[tuple[str, ...], Server] = {}
        for name, arguments, _ in WAYS:
            if arguments not in servers:
                servers[arguments] = Server(name, arguments)
                stack.callback(servers[arguments].stop)
        for subscribers in (1, 10):
            found: dict[str, list[Way]] = {name: [] for name, _, _ in WAYS}
            for _ in range(rounds):
                for name, arguments, compression in WAYS:
                    found[name].append(way_through(servers[arguments], compression, subscribers, seconds))
            lines += (line(f"1→{subscribers} {name}", ways, found[RELAY]) for name, ways in found.items())
    return "\n".join(lines)


def line(label: str, ways: Sequence[Way], relayed: Sequence[Way]) -> str:
    pairs = list(zip(ways, relayed, strict=True))
    cells = (
        f"{median(way.rate for way in ways):,.0f}",
        f"{median(mine.rate / other.rate for mine, other in pairs):.2f}",
        f"{median(way.cpu for way in ways):,.0f}",
        f"{median(mine.cpu / other.cpu for mine, other in pairs):.2f}",
        f"{median(way.kernel for way in ways):.0%}",
        f"{median(way.faults for way in ways):.0f}",
    )
    return f"{label:<24}" + "".join(f"{cell:>13}" for cell in cells)


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
    parser.add_argument("--frame", action="store_true", help="a frame of 1 MB through servers, in turns")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="of --frame (default 5)")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each load of --frame (default 1)")
    options = parser.parse_args(argv)
    if options.frame:
        print(large_frames(options.rounds, options.seconds))
        return 0
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
