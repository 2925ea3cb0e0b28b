"""`python -m bench.fleet.load_1000`: a thousand clients, ten of them stopped dead, 20 topics at 100 Hz each.

The ten subscribe to every topic and never read again. The others are in two groups: operators, who get one
topic at its full 100 Hz, and dashboards, who get two topics once a second each (`throttle_rate`). One client
publishes, one more calls a service all the while, so that it shows how long a healthy client waits. Exits
with 1 when an operator has lost a message, a dashboard has starved, or memory has grown.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bench.traffic.messages import Stream, twists
from bench.traffic.processes import Server, cpu_time
from bench.traffic.wire import Connection, Loop, masked

SERVER = Path(__file__).parent.parent / "peers" / "server.py"
TOPICS = 20
HERTZ = 100
STOPPED = 10
STOPPED_BUFFER_BYTES = 4096
"""Receive buffer of each stopped client; the kernel's default would hide the server's own limits."""
FILES = 4096
GRACE_SECONDS = 10.0
ROOM_MB = 8.0
"""Growth of memory that counts as flat: what an allocator may keep."""
CALL_SECONDS = 0.05


@dataclass(slots=True)
class Outcome:
    """Measurements.

    Attributes:
        published: messages on all topics while measuring.
        offered: messages on all topics since the beginning.
        seconds: for how long.
        delivered: messages that operators and dashboards received meanwhile.
        lost: messages that operators did not receive, all of them together.
        woken: messages that one of the stopped got when it read again after all, the fewest.
        starved: dashboards that got less than one message in two seconds on average.
        calls: round trips of the service, milliseconds, ascending.
        memory: resident MB of the server: idle, with all connected, when measuring began, at its end, peak.
        cpu: seconds of the server's process a second.
        load_cpu: the same for the load.
    """

    published: int = 0
    offered: int = 0
    seconds: float = 0.0
    delivered: int = 0
    lost: int = 0
    woken: int = 0
    starved: int = 0
    calls: list[float] = field(default_factory=list)
    memory: list[float] = field(default_factory=list)
    cpu: float = 0.0
    load_cpu: float = 0.0

    @property
    def good(self) -> bool:
        return not self.lost and not self.starved and self.memory[3] - self.memory[2] <= ROOM_MB


class Crowd:
    """Everyone who is connected."""

    def __init__(self, server: Server, loop: Loop, clients: int, operators: int) -> None:
        self.loop = loop
        self.streams = [twists(f"/robot_{number}/cmd_vel") for number in range(TOPICS)]
        self.frames = [[masked(each.publish(message)) for message in each.messages] for each in self.streams]
        self.published = [0] * TOPICS
        self.publisher = Connection(loop, server.host, server.port)
        for stream in self.streams:
            self.publisher.send(masked(stream.advertise()))
        # Subscribing needs the topics, which another connection advertises.
        loop.settle()
        self.stopped = [
            Connection(loop, server.host, server.port, STOPPED_BUFFER_BYTES) for _ in range(STOPPED)
        ]
        self.operators = [Connection(loop, server.host, server.port) for _ in range(operators)]
        healthy = clients - STOPPED - operators
        self.dashboards = [Connection(loop, server.host, server.port) for _ in range(healthy)]
        self.caller = Connection(loop, server.host, server.port)
        self._subscribe()
        loop.settle()
        for connection in self.stopped:
            connection.stop_reading()

    def _subscribe(self) -> None:
        for connection in self.stopped:
            for stream in self.streams:
                connection.send(masked(stream.subscribe()))
        for number, connection in enumerate(self.operators):
            connection.send(masked(self.streams[number % TOPICS].subscribe()))
        for number, connection in enumerate(self.dashboards):
            for each in (number, number + TOPICS // 2):
                connection.send(masked(_throttled(self.streams[each % TOPICS])))

    def publish(self) -> None:
        """One message on every topic."""
        for number, frames in enumerate(self.frames):
            self.publisher.send(frames[self.published[number] % len(frames)])
            self.published[number] += 1

    @property
    def delivered(self) -> int:
        return sum(each.received for each in (*self.operators, *self.dashboards))

    def missing(self) -> int:
        """Messages that operators have not received yet."""
        return sum(
            self.published[number % TOPICS] - each.received for number, each in enumerate(self.operators)
        )

    def wake_the_stopped(self) -> int:
        """Let them read; the fewest messages that one of them got in all its life."""
        for connection in self.stopped:
            connection.read_again()
        self.loop.settle(0.5)
        return min(connection.received for connection in self.stopped)

    def starved(self, seconds: float) -> int:
        return sum(each.received < seconds for each in self.dashboards)


def _throttled(stream: Stream) -> bytes:
    op = {**json.loads(stream.subscribe()), "throttle_rate": 1000}
    return json.dumps(op, separators=(",", ":")).encode()


class Caller:
    """Calls a service again and again, and notes how long each answer took."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._kept = connection.keep_messages()
        self._sent = 0.0
        self._waiting = False
        self.milliseconds: list[float] = []

    def turn(self, now: float) -> None:
        if self._waiting and self._kept:
            assert json.loads(self._kept.pop())["values"] == {"sum": 3}
            self._waiting = False
            self.milliseconds.append((now - self._sent) * 1000)
        elif not self._waiting and now - self._sent >= CALL_SECONDS:
            call = {"op": "call_service", "service": "/add_two_ints", "args": {"a": 1, "b": 2}}
            self._sent, self._waiting = time.monotonic(), True
            self._connection.send(masked(json.dumps(call).encode()))


def flow(crowd: Crowd, caller: Caller, seconds: float) -> None:
    """Publish at the rate for so long, and read whatever comes. A load that falls behind catches up."""
    begin = time.monotonic()
    ticks, due = 0, int(seconds * HERTZ)
    while ticks < due:
        now = time.monotonic()
        if now >= begin + ticks / HERTZ:
            crowd.publish()
            ticks += 1
        crowd.loop.turn(min(0.002, max(0.0, begin + ticks / HERTZ - now)))
        caller.turn(time.monotonic())


def measure(server: Server, clients: int, operators: int, settle: float, seconds: float) -> Outcome:
    """The whole run against a server that has just started."""
    outcome = Outcome(memory=[server.memory().now])
    with contextlib.closing(Loop()) as loop:
        crowd = Crowd(server, loop, clients, operators)
        caller = Caller(crowd.caller)
        outcome.memory.append(server.memory().now)
        begin = time.monotonic()
        flow(crowd, caller, settle)
        outcome.memory.append(server.memory().now)
        caller.milliseconds.clear()
        published, delivered = sum(crowd.published), crowd.delivered
        cpu, own = server.cpu_time().used, cpu_time_of_load()
        start = time.monotonic()
        flow(crowd, caller, seconds)
        outcome.seconds = time.monotonic() - start
        outcome.cpu = (server.cpu_time().used - cpu) / outcome.seconds
        outcome.load_cpu = (cpu_time_of_load() - own) / outcome.seconds
        outcome.published = sum(crowd.published) - published
        outcome.offered = sum(crowd.published)
        outcome.delivered = crowd.delivered - delivered
        memory = server.memory()
        outcome.memory += [memory.now, memory.peak]
        loop.until(lambda: crowd.missing() <= 0, GRACE_SECONDS)
        outcome.lost = crowd.missing()
        outcome.starved = crowd.starved(time.monotonic() - begin - GRACE_SECONDS)
        outcome.calls = sorted(caller.milliseconds)
        outcome.woken = crowd.wake_the_stopped()
    return outcome


def cpu_time_of_load() -> float:
    return cpu_time(os.getpid()).used


def report(outcome: Outcome, clients: int, operators: int) -> str:
    calls = outcome.calls
    dashboards = clients - STOPPED - operators
    rate = outcome.published / outcome.seconds
    median, late = calls[len(calls) // 2], calls[int(len(calls) * 0.99)]
    idle, connected, settled, end, peak = outcome.memory
    return f"""\
{clients} clients: {STOPPED} stopped dead, {operators} operators, {dashboards} dashboards; {TOPICS} topics
published          {rate:10,.0f} a second ({rate / TOPICS:.1f} Hz a topic, for {outcome.seconds:.0f} s)
delivered          {outcome.delivered / outcome.seconds:10,.0f} a second
lost by operators  {outcome.lost:10,}
dashboards starved {outcome.starved:10,}
the stopped        {outcome.woken:10,} messages at least of {outcome.offered:,}, when they read again
service call, ms   {median:10.1f} median, {late:.1f} at 99 %, {calls[-1]:.1f} at most
memory, MB         {idle:10.1f} idle, {connected:.1f} all connected, {settled:.1f} the stopped are full
memory, MB         {end:10.1f} at the end, {peak:.1f} peak
CPU                {outcome.cpu:10.0%} server, {outcome.load_cpu:.0%} load"""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.fleet.load_1000", description=__doc__)
    parser.add_argument("--clients", type=int, default=1000, help="all together, the stopped included")
    parser.add_argument("--operators", type=int, default=790, help="how many get a topic at its full rate")
    parser.add_argument(
        "--settle",
        type=float,
        default=20.0,
        metavar="SECONDS",
        help="before measuring, until the bounds of the stopped are full",
    )
    parser.add_argument("--seconds", type=float, default=30.0, help="of measuring")
    chosen = parser.parse_args(argv)
    raise_file_limit()
    server = Server("server", [str(SERVER)])
    try:
        outcome = measure(server, chosen.clients, chosen.operators, chosen.settle, chosen.seconds)
    finally:
        server.stop()
    print(report(outcome, chosen.clients, chosen.operators))
    return 0 if outcome.good else 1


def raise_file_limit() -> None:
    """A socket is a file, and many systems allow 1,024 of them unless asked."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < FILES:
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(FILES, hard), hard))


if __name__ == "__main__":
    sys.exit(main())
