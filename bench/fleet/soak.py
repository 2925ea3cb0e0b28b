"""`python -m bench.fleet.soak`: clients that come and go in every way, for ten minutes.

In each round some clients join, subscribe and publish, one provides a service, and then each leaves in its
own way: with a close frame, without a word, with a reset, in the midst of a frame, of a message in fragments,
of the handshake or of a call. When all have gone the server's memory and open files are noted. Exits with 1
when either has grown: memory from the first third after the warm-up to the last, files from the first round.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import socket
import struct
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.traffic.messages import twists
from bench.traffic.processes import Server
from bench.traffic.wire import Connection, Loop, masked

SERVER = Path(__file__).parent.parent / "peers" / "server.py"
CLIENTS = 40
"""Clients of one round."""
PUBLISHED = 20
"""Messages that each client publishes in its life."""
WARM_UP = 0.25
"""Share of the time after which memory counts."""
ROOM_MB = 4.0
"""Growth of memory that counts as flat: what an allocator may keep."""
EMPTY_SECONDS = 5.0
"""Timeout for the server to drop all clients."""

_HANDSHAKE = b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConn"
_CLOSE = masked((1000).to_bytes(2, "big"), 8)


@dataclass(frozen=True, slots=True)
class Sample:
    """The server without clients."""

    after: float
    memory: float
    files: int


def _op(**op: object) -> bytes:
    return masked(json.dumps(op).encode())


def _kindly(connection: Connection) -> None:
    connection.send(_CLOSE)


def _without_a_word(connection: Connection) -> None:
    """The network says the rest."""


def _in_a_frame(connection: Connection) -> None:
    connection.send(_op(op="publish", topic="/soak", msg={"data": "x" * 500})[:300])


def _in_a_large_frame(connection: Connection) -> None:
    connection.send(_op(op="publish", topic="/soak", msg={"data": "x" * 100_000})[:60_000])


def _in_fragments(connection: Connection) -> None:
    connection.send(_op(op="fragment", id="f", data='{"op":', num=0, total=3))


def _as_its_service_is_called(connection: Connection) -> None:
    connection.send(
        _op(op="call_service", service="/demanding", id="1", args={"data": True}, timeout=0)
        + _op(op="send_action_goal", action="/nobody", action_type="example_interfaces/Fibonacci", args={})
    )


LEAVING: dict[str, Callable[[Connection], None]] = {
    "kindly": _kindly,
    "without a word": _without_a_word,
    "in a frame": _in_a_frame,
    "in a large frame": _in_a_large_frame,
    "in a message of fragments": _in_fragments,
    "in a call": _as_its_service_is_called,
}


class Soak:
    """Rounds of clients against one server."""

    def __init__(self, server: Server, seed: int) -> None:
        self._server = server
        self._random = random.Random(seed)
        self._stream = twists("/soak_cmd")
        self._frames = [masked(self._stream.publish(message)) for message in self._stream.messages]
        self.left: Counter[str] = Counter()
        self.delivered = 0
        self.files_at_most = 0

    def round(self) -> None:
        """Clients join, talk and leave."""
        with contextlib.closing(Loop()) as loop:
            self._half_handshakes(5)
            clients = [Connection(loop, self._server.host, self._server.port) for _ in range(CLIENTS)]
            for number, client in enumerate(clients):
                client.send(self._greeting(number))
            loop.settle(0.02)
            self.files_at_most = max(self.files_at_most, self._server.files())
            for at in range(PUBLISHED):
                for client in clients[::4]:
                    client.send(self._frames[at % len(self._frames)])
                loop.turn(0.001)
            loop.settle(0.02)
            self.delivered += sum(client.received for client in clients)
            self._random.shuffle(clients)
            for client in clients:
                self._leave(client)

    def _greeting(self, number: int) -> bytes:
        common = masked(self._stream.advertise()) + masked(self._stream.subscribe())
        if number:
            return common
        return common + _op(op="advertise_service", service="/demanding", type="std_srvs/SetBool")

    def _leave(self, client: Connection) -> None:
        way = self._random.choice(list(LEAVING))
        LEAVING[way](client)
        reset = self._random.random() < 0.5
        client.drop(reset=reset)
        self.left[f"{way}, {'reset' if reset else 'closed'}"] += 1

    def _half_handshakes(self, count: int) -> None:
        for number in range(count):
            with socket.create_connection((self._server.host, self._server.port), 5) as half:
                half.sendall(_HANDSHAKE[: 1 + number * 10])
                if number % 2:
                    half.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self.left["in the handshake"] += 1

    def emptied(self, files: int) -> bool:
        """Wait until the server has let everyone go; whether it did."""
        deadline = time.monotonic() + EMPTY_SECONDS
        while self._server.files() > files:
            if time.monotonic() > deadline:
                return False
            time.sleep(0.02)
        return True


def soak(server: Server, seconds: float, seed: int) -> tuple[Soak, list[Sample]]:
    """Rounds for so long; samples after each."""
    soaked = Soak(server, seed)
    soaked.round()
    time.sleep(1)
    files = server.files()
    samples: list[Sample] = []
    start = time.monotonic()
    while (after := time.monotonic() - start) < seconds:
        soaked.round()
        soaked.emptied(files)
        samples.append(Sample(after, server.memory().now, server.files()))
    return soaked, samples


def verdict(soaked: Soak, samples: list[Sample]) -> tuple[str, bool]:
    """The figures in words, and whether memory and files stayed flat."""
    settled = [sample for sample in samples if sample.after >= samples[-1].after * WARM_UP]
    third = max(1, len(settled) // 3)
    first = max(sample.memory for sample in settled[:third])
    last = max(sample.memory for sample in settled[-third:])
    files = {sample.files for sample in samples}
    clients = sum(soaked.left.values())
    ways = "\n".join(f"  {way:40} {count:8,}" for way, count in sorted(soaked.left.items()))
    text = f"""\
{clients:,} clients came and went in {samples[-1].after:.0f} s, {len(samples)} times all at once
{ways}
messages     {soaked.delivered:,} delivered
memory, MB   {samples[0].memory:.1f} after the first round, {first:.1f} soon after, {last:.1f} at the end
open files   {min(files)} to {max(files)} with nobody connected, {soaked.files_at_most} at most"""
    return text, last - first <= ROOM_MB and samples[-1].files <= samples[0].files


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.fleet.soak", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=1, help="of who leaves how")
    chosen = parser.parse_args(argv)
    server = Server("server", [str(SERVER)])
    try:
        soaked, samples = soak(server, chosen.seconds, chosen.seed)
    finally:
        server.stop()
    text, flat = verdict(soaked, samples)
    print(text)
    return 0 if flat else 1


if __name__ == "__main__":
    sys.exit(main())
