"""`python -m bench.fleet.two_servers`: 200 clients over two servers of one graph, beside 200 at one server.

Publishers are at each server and every client hears all of them. Each message says who published it, which
one it is and when, and every one is looked at: each must come to each client once, in the order of its
publisher.
"""

from __future__ import annotations

import argparse
import json
import re
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from statistics import quantiles

from bench.fleet.load_1000 import raise_file_limit
from bench.traffic.processes import Server
from bench.traffic.wire import Connection, Loop, masked

TOPIC, TYPE = "/fleet", "std_msgs/String"
PUBLISHERS = 4
_GRACE_SECONDS = 15.0
_STAMPED = re.compile(rb'"data":"(\d+) (\d+) ([\d.]+)"')


@dataclass(frozen=True, slots=True)
class Outcome:
    """Deliveries.

    Attributes:
        due: deliveries that there should be: messages times clients.
        delivered: those that were.
        twice: deliveries of a message that the client had.
        disordered: deliveries before which a later message of the same publisher came.
        seconds: from the first message to the last delivery.
        cpu: seconds on a CPU of each server.
        milliseconds: of all messages, on their way; ascending percentiles 1 to 99.
    """

    due: int
    delivered: int
    twice: int
    disordered: int
    seconds: float
    cpu: tuple[float, ...]
    milliseconds: tuple[float, ...]

    @property
    def good(self) -> bool:
        """True if every message was delivered to every client, once and in order."""
        return self.delivered == self.due and not self.twice and not self.disordered

    def line(self, name: str) -> str:
        """For people."""
        return (
            f"{name:24}{self.delivered:>10,} of {self.due:,} deliveries, twice {self.twice}, out of order "
            f"{self.disordered}; {self.delivered / self.seconds:,.0f}/s, p50 {self.milliseconds[49]:.1f} ms, "
            f"p99 {self.milliseconds[98]:.1f} ms; {sum(self.cpu) / self.delivered * 1e6:.1f} us of CPU each"
        )


class Client:
    """A subscriber that looks at everything it hears."""

    def __init__(self, connection: Connection, delays: list[float]) -> None:
        self._kept = connection.keep_messages()
        self._delays = delays
        self._last: dict[bytes, int] = {}
        self._seen: set[tuple[bytes, int]] = set()
        self.ready = False
        self.delivered = self.twice = self.disordered = 0
        connection.on_data = self._look

    def _look(self) -> None:
        now = time.perf_counter()
        for message in self._kept:
            found = _STAMPED.search(message)
            if found is None:
                self.ready = True
                continue
            who, number = found[1], int(found[2])
            self.twice += (who, number) in self._seen
            self._seen.add((who, number))
            self.disordered += number < self._last.get(who, -1)
            self._last[who] = number
            self.delivered += 1
            self._delays.append((now - float(found[3])) * 1e3)
        self._kept.clear()


class Fleet:
    """Clients and publishers, spread evenly over servers."""

    def __init__(self, servers: Sequence[Server], clients: int) -> None:
        self.loop = Loop()
        self._servers = servers
        self.delays: list[float] = []
        at = [servers[number % len(servers)] for number in range(clients)]
        self._connections = [Connection(self.loop, each.host, each.port) for each in at]
        self.clients = [Client(each, self.delays) for each in self._connections]
        homes = [servers[number % len(servers)] for number in range(PUBLISHERS)]
        self.publishers = [Connection(self.loop, each.host, each.port) for each in homes]
        for each in self._connections:
            each.send(_op(op="subscribe", topic=TOPIC, type=TYPE))
        for each in self.publishers:
            each.send(_op(op="advertise", topic=TOPIC, type=TYPE))
        self._probe()

    def _probe(self) -> None:
        """Until everybody hears every publisher: each says a word of its own, until all clients have it."""
        for publisher in self.publishers:
            for client in self.clients:
                client.ready = False
            deadline = time.monotonic() + _GRACE_SECONDS
            while not self._all_ready() and time.monotonic() < deadline:
                publisher.send(_op(op="publish", topic=TOPIC, msg={"data": "probe"}))
                self.loop.until(self._all_ready, 0.1)
            self.loop.settle(0.2)

    def _all_ready(self) -> bool:
        return all(client.ready for client in self.clients)

    def run(self, rate: float, count: int) -> Outcome:
        """Let each publisher send `count` messages, so many a second."""
        before = [server.cpu_time().used for server in self._servers]
        begin = time.monotonic()
        for number in range(count):
            for who, publisher in enumerate(self.publishers):
                data = f"{who} {number} {time.perf_counter()}"
                publisher.send(_op(op="publish", topic=TOPIC, msg={"data": data}))
            while (left := begin + (number + 1) / rate - time.monotonic()) > 0:
                self.loop.turn(left)
        due = count * PUBLISHERS * len(self.clients)
        self.loop.until(lambda: self._sum(lambda client: client.delivered) >= due, _GRACE_SECONDS)
        return Outcome(
            due,
            self._sum(lambda client: client.delivered),
            self._sum(lambda client: client.twice),
            self._sum(lambda client: client.disordered),
            time.monotonic() - begin,
            tuple(s.cpu_time().used - b for s, b in zip(self._servers, before, strict=True)),
            tuple(quantiles(self.delays, n=100)),
        )

    def _sum(self, value: Callable[[Client], int]) -> int:
        return sum(map(value, self.clients))

    def close(self) -> None:
        for each in (*self.publishers, *self._connections):
            each.close()
        self.loop.close()


def _op(**op: object) -> bytes:
    return masked(json.dumps(op, separators=(",", ":")).encode())


def measure(servers: Sequence[Server], clients: int, rate: float, count: int) -> Outcome:
    with closing(Fleet(servers, clients)) as fleet:
        return fleet.run(rate, count)


def serve(name: str, *options: str) -> Server:
    return Server(name, ["-m", "rwt.cli", "serve", "ws://127.0.0.1:0", *options])


def two_servers(stack: ExitStack) -> list[Server]:
    """Two processes with one graph; `stack` ends them."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        place = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    servers = []
    for name, how in (("first", "--zenoh-listen"), ("second", "--zenoh-connect")):
        servers.append(serve(name, "--graph", "zenoh", how, place))
        stack.callback(servers[-1].stop)
    return servers


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.fleet.two_servers", description=__doc__)
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--rate", type=float, default=50.0, help="messages a second of each publisher")
    parser.add_argument("--count", type=int, default=250, help="messages of each publisher")
    options = parser.parse_args(argv)
    raise_file_limit()
    with ExitStack() as stack:
        memory = serve("memory")
        stack.callback(memory.stop)
        alone = measure([memory], options.clients, options.rate, options.count)
        print(alone.line("one server, in memory"), flush=True)
        joined = measure(two_servers(stack), options.clients, options.rate, options.count)
        print(joined.line("two servers, over Zenoh"))
    return int(not (alone.good and joined.good))


if __name__ == "__main__":
    raise SystemExit(main())
