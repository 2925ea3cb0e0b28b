"""`python -m bench.fleet.workers`: the fan-out of one process beside that of `rwt serve --workers 2`.

One client publishes small Twists at a fixed rate, each a write of its own, and many clients on the same port
listen. The load reads seldom and much at a time, without polling, so that it hardly needs a CPU. What is
compared is how many deliveries a server makes for each second on a CPU of its *busiest* process, that is: how
far it would get before one of its processes has a whole core. That does not depend on how much of the two
cores the load and other programs take, which deliveries a second do.
"""

from __future__ import annotations

import argparse
import itertools
import os
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from bench.fleet.load_1000 import raise_file_limit
from bench.traffic.messages import twists
from bench.traffic.processes import Server, cpu_time
from bench.traffic.wire import Connection, Loop, masked

FLOOR = 1.6
_SWEEP_SECONDS = 0.04
_GRACE_SECONDS = 10.0


class Workers(Server):
    """A server of one process or of several."""

    def __init__(self, count: int) -> None:
        shared = ["--workers", str(count)] if count > 1 else []
        self.count = count
        super().__init__(f"{count}", ["-m", "rwt.cli", "serve", "ws://127.0.0.1:0", *shared])

    def each(self) -> list[float]:
        """Seconds on a CPU of each process that serves."""
        if self.count == 1:
            return [cpu_time(self.pid).used]
        children = Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text().split()
        return [cpu_time(int(pid)).used for pid in children]


@dataclass(frozen=True, slots=True)
class Turn:
    """Measurements of one server in one turn.

    Attributes:
        delivered: messages to clients.
        lost: those that never came.
        seconds: how long it took.
        cpu: of each of its processes, in seconds.
        load_cpu: of the load.
    """

    delivered: int
    lost: int
    seconds: float
    cpu: tuple[float, ...]
    load_cpu: float

    @property
    def per_busiest(self) -> float:
        """Deliveries for each CPU second of the busiest process."""
        return self.delivered / max(self.cpu)

    @property
    def per_total(self) -> float:
        """Deliveries for each CPU second of all together."""
        return self.delivered / sum(self.cpu)


class Crowd:
    """A publisher and its subscribers at one server."""

    def __init__(self, server: Workers, subscribers: int, rate: float) -> None:
        self._server = server
        self._rate = rate
        self._loop = Loop()
        stream = twists()
        self.publisher = Connection(self._loop, server.host, server.port)
        self.publisher.send(masked(stream.advertise()))
        self.readers = [Connection(self._loop, server.host, server.port) for _ in range(subscribers)]
        for reader in self.readers:
            reader.send(masked(stream.subscribe()))
        self._frames = itertools.cycle([masked(stream.publish(message)) for message in stream.messages])
        self._probe()
        for reader in self.readers:
            reader.stop_reading()

    def _probe(self) -> None:
        """Publish until everybody hears it, wherever he is connected."""
        deadline = time.monotonic() + _GRACE_SECONDS
        while not all(reader.received for reader in self.readers) and time.monotonic() < deadline:
            self.publisher.send(next(self._frames))
            self._loop.until(lambda: False, 0.05)
        self._loop.settle(0.2)

    @property
    def received(self) -> int:
        return sum(reader.received for reader in self.readers)

    def flow(self, seconds: float) -> int:
        """Publish for so long; how many."""
        begin = swept = time.monotonic()
        sent = 0
        while sent < seconds * self._rate:
            now = time.monotonic()
            if now >= begin + sent / self._rate:
                self.publisher.send(next(self._frames))
                sent += 1
            elif now - swept > _SWEEP_SECONDS:
                self._loop.sweep(self.readers)
                swept = now
            else:
                time.sleep(min(begin + sent / self._rate - now, _SWEEP_SECONDS))
        return sent

    def turn(self, seconds: float) -> Turn:
        """Warm up, and measure."""
        self.flow(0.4)
        time.sleep(0.3)
        self._loop.sweep(self.readers)
        before, start = self.received, time.monotonic()
        cpu, own = self._server.each(), cpu_time(os.getpid()).used
        sent = self.flow(seconds)
        took = time.monotonic() - start
        used = tuple(b - a for a, b in zip(cpu, self._server.each(), strict=True))
        load = cpu_time(os.getpid()).used - own
        due = sent * len(self.readers)
        deadline = time.monotonic() + _GRACE_SECONDS
        while self.received - before < due and time.monotonic() < deadline:
            time.sleep(_SWEEP_SECONDS)
            self._loop.sweep(self.readers)
        got = self.received - before
        return Turn(got, due - got, took, used, load)

    def close(self) -> None:
        for reader in self.readers:
            reader.read_again()
        for each in (self.publisher, *self.readers):
            each.close()
        self._loop.close()


def take_turn(server: Workers, subscribers: int, rate: float, seconds: float) -> Turn:
    with closing(Crowd(server, subscribers, rate)) as crowd:
        return crowd.turn(seconds)


def line(server: Workers, turn: Turn) -> str:
    each = " + ".join(f"{seconds / turn.seconds:.0%}" for seconds in turn.cpu)
    return (
        f"{server.count} process{'es' if server.count > 1 else '  '} {turn.delivered / turn.seconds:9,.0f}/s"
        f"   CPU {each:>11}   load {turn.load_cpu / turn.seconds:4.0%}   lost {turn.lost}"
        f"   a CPU second: busiest {turn.per_busiest:9,.0f}, all {turn.per_total:9,.0f}"
    )


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.fleet.workers", description=__doc__)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--clients", type=int, default=500, help="subscribers (default 500)")
    parser.add_argument("--rate", type=float, default=100.0, help="messages a second (default 100)")
    parser.add_argument("--seconds", type=float, default=2.0, help="per turn (default 2)")
    parser.add_argument("--rounds", type=int, default=7, help="turns of each server (default 7)")
    parser.add_argument("--check", action="store_true", help="exit with 1 below the floor or after a loss")
    options = parser.parse_args(argv)
    raise_file_limit()
    ratios, lost = [], 0
    with ExitStack() as stack:
        servers = [Workers(1), Workers(options.workers)]
        for server in servers:
            stack.callback(server.stop)
        for _ in range(options.rounds):
            turns = [take_turn(each, options.clients, options.rate, options.seconds) for each in servers]
            for server, turn in zip(servers, turns, strict=True):
                print(line(server, turn), flush=True)
            ratios.append(turns[1].per_busiest / turns[0].per_busiest)
            lost += sum(turn.lost for turn in turns)
    ratio = median(ratios)
    print(f"ratio of the busiest processes: {ratio:.2f} ({min(ratios):.2f} - {max(ratios):.2f}), ", end="")
    print(f"floor {FLOOR}; lost {lost}")
    return int(options.check and (ratio < FLOOR or lost > 0))


if __name__ == "__main__":
    raise SystemExit(main())
