"""The load: what one server is asked to do for a while, and what came of it.

Every load is a closed loop: no more than a window of messages is on its way at any time, so that a server is
always busy, nothing piles up, and nothing has a reason to be dropped. What is lost anyway is counted.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from bench.traffic.dialects import DEFLATE, PER_MESSAGE_DEFLATE, WrongAnswer
from bench.traffic.messages import Stream, advertise_service, call, twist, twists
from bench.traffic.processes import CpuTime, Server, cpu_time
from bench.traffic.wire import Connection, Loop, masked

WARM_UP_SECONDS: Final = 0.3
GRACE_SECONDS: Final = 5.0
CONNECT_SECONDS: Final = 0.05
"""Time per subscriber that a busy machine may take until all are connected."""
QUIET_SECONDS: Final = 0.25
PROBE_SECONDS: Final = 0.05
LATENCY_HZ: Final = 200

SERVICE_TYPE: Final = "example_interfaces/AddTwoInts"
CALL_IDS: Final = 1024
ID: Final = re.compile(rb'"id":\s*("[^"]*"|\d+)')
STAMP: Final = re.compile(rb'"x":\s*([0-9.]+)')


@dataclass(frozen=True, slots=True)
class Throughput:
    """Deliveries of a server in a period.

    Attributes:
        count: deliveries, or calls answered.
        seconds: how long it took.
        cpu: seconds that the server spent on the CPU meanwhile.
        load_cpu: the same for the load; near `seconds` means that the load may have been the bottleneck.
        waited: seconds for which server and load were ready to run and did not get a CPU.
        lost: deliveries that never came, in the whole run.
    """

    count: int
    seconds: float
    cpu: float
    load_cpu: float
    waited: float
    lost: int

    @property
    def rate(self) -> float:
        return self.count / self.seconds

    @property
    def cpu_per_10k(self) -> float:
        return self.cpu / self.count * 10_000


@dataclass(frozen=True, slots=True)
class Latency:
    """Latencies of messages.

    Attributes:
        milliseconds: from before each message was written until it was read, ascending.
        seconds, waited, lost: as in `Throughput`.
    """

    milliseconds: tuple[float, ...]
    seconds: float
    waited: float
    lost: int

    def percentile(self, percent: float) -> float:
        return self.milliseconds[min(int(len(self.milliseconds) * percent / 100), len(self.milliseconds) - 1)]


@dataclass(frozen=True, slots=True)
class Window:
    """Limit of messages in flight: `size` at most, sent `batch` in one write.

    Between two looks at its sockets the load sleeps for `nap` seconds. With many subscribers that lets it
    read many frames at once, without which it would need a whole core and hold the server back; the window
    is wide enough to keep the server busy meanwhile.
    """

    size: int
    batch: int
    nap: float = 0.0


def fan_out(
    server: Server,
    stream: Stream,
    subscribers: int,
    window: Window,
    seconds: float,
    compressions: Sequence[str] = ("none",),
) -> Throughput:
    """One publisher, so many subscribers, one connection each; they ask for the encodings in turn."""
    with _Session(server) as session:
        publisher, readers = session.join(stream, subscribers, compressions)
        frames = [server.dialect.publish(stream, message) for message in stream.messages]
        writes = itertools.cycle([b"".join(batch) for batch in _batches(frames, window.batch)])
        start = sum(reader.received for reader in readers)
        sent = 0

        def received() -> int:
            return sum(reader.received for reader in readers) - start

        def keep_going() -> None:
            nonlocal sent
            room = window.size - (sent - received() // subscribers)
            while room >= window.batch and publisher.writable:
                publisher.send(next(writes))
                sent += window.batch
                room -= window.batch

        session.loop.nap = window.nap
        begin, end = session.sustain(keep_going, received, seconds)
        session.loop.until(lambda: received() >= sent * subscribers, GRACE_SECONDS)
        return _throughput(begin, end, lost=sent * subscribers - received())


def latency(server: Server, seconds: float) -> Latency:
    """One publisher and one subscriber; each message carries the time at which it was made."""
    stream = twists("/timed")
    period = 1 / LATENCY_HZ
    with _Session(server) as session:
        publisher, (reader,) = session.join(stream, 1)
        messages = reader.keep_messages()
        arrived: list[float] = []

        def note_arrival() -> None:
            now = time.perf_counter()
            for message in messages:
                found = STAMP.search(message)
                assert found is not None
                arrived.append((now - float(found[1])) * 1e3)
            messages.clear()

        reader.on_data = note_arrival
        sent = int(seconds * LATENCY_HZ)
        begin = session.moment(0)
        due = time.perf_counter()
        for _ in range(sent):
            publisher.send(masked(stream.publish(twist(time.perf_counter(), 0.5))))
            due += period
            while (left := due - time.perf_counter()) > 0:
                session.loop.turn(left)
        session.loop.until(lambda: len(arrived) >= sent, GRACE_SECONDS)
        end = session.moment(len(arrived))
        return Latency(
            tuple(sorted(arrived)), end.time - begin.time, _waited(begin, end), sent - len(arrived)
        )


def service_calls(
    server: Server, service: str, depth: int, seconds: float, provided_here: bool
) -> Throughput:
    """One caller with `depth` calls in flight; the provider is another client, or is in the server."""
    with _Session(server) as session:
        if provided_here:
            session.provide(service)
        caller = session.connect()
        session.check_service(caller, service)
        calls = [masked(call(service, f"call_service:{service}:{n}", n, 1)) for n in range(CALL_IDS)]
        writes = itertools.cycle(calls)
        start = caller.received
        sent = 0

        def received() -> int:
            return caller.received - start

        def keep_going() -> None:
            nonlocal sent
            if room := depth - (sent - received()):
                caller.send(b"".join(itertools.islice(writes, room)))
                sent += room

        begin, end = session.sustain(keep_going, received, seconds)
        session.loop.until(lambda: received() >= sent, GRACE_SECONDS)
        lost = sent - received()
        session.check_service(caller, service)
        return _throughput(begin, end, lost)


@dataclass(frozen=True, slots=True)
class _Moment:
    time: float
    received: int
    server: CpuTime
    load: CpuTime


def _throughput(begin: _Moment, end: _Moment, lost: int) -> Throughput:
    return Throughput(
        count=end.received - begin.received,
        seconds=end.time - begin.time,
        cpu=end.server.used - begin.server.used,
        load_cpu=end.load.used - begin.load.used,
        waited=_waited(begin, end),
        lost=lost,
    )


def _waited(begin: _Moment, end: _Moment) -> float:
    return end.server.waited - begin.server.waited + end.load.waited - begin.load.waited


def _batches(frames: list[bytes], size: int) -> list[list[bytes]]:
    return [frames[start : start + size] for start in range(0, len(frames), size)]


class _Session:
    """The connections of one load to one server."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._connections: list[Connection] = []
        self.loop = Loop()

    def __enter__(self) -> _Session:
        return self

    def __exit__(self, *exc: object) -> None:
        for connection in self._connections:
            connection.close()
        self.loop.close()

    def connect(self, extension: str = "") -> Connection:
        server = self._server
        connection = Connection(
            self.loop,
            server.host,
            server.port,
            subprotocol=server.dialect.subprotocol,
            extension=extension,
        )
        self._connections.append(connection)
        return connection

    def join(
        self, stream: Stream, subscribers: int, compressions: Sequence[str] = ("none",)
    ) -> tuple[Connection, list[Connection]]:
        """Advertise and subscribe; return when a message has reached every subscriber as it was sent."""
        dialect = self._server.dialect
        publisher = self.connect()
        publisher.send(dialect.advertise(stream))
        asked = list(itertools.islice(itertools.cycle(compressions), subscribers))
        readers = [self.connect(PER_MESSAGE_DEFLATE if each == DEFLATE else "") for each in asked]
        kept = [reader.keep_messages() for reader in readers]
        for reader, compression in zip(readers, asked, strict=True):
            reader.send(dialect.subscribe(stream, compression))
        self.loop.settle(QUIET_SECONDS)  # A relay forwards these too.
        for messages in kept:
            messages.clear()
        probe = dialect.publish(stream, stream.messages[0])
        deadline = time.monotonic() + GRACE_SECONDS + subscribers * CONNECT_SECONDS
        probes = 0
        while not all(kept):
            if time.monotonic() > deadline:
                raise WrongAnswer(f"{self._server.name}: no message on {stream.topic} reached a subscriber")
            publisher.send(probe)
            probes += 1
            self.loop.until(lambda: all(kept), PROBE_SECONDS)
        # What is still on its way would be counted as part of the load.
        self.loop.until(lambda: all(len(messages) >= probes for messages in kept), GRACE_SECONDS)
        self.loop.settle()
        for reader, messages, compression in zip(readers, kept, asked, strict=True):
            message = dialect.delivered(stream, messages[-1], compression)
            if message is not None and not stream.is_first(message):
                raise WrongAnswer(f"{self._server.name}: a subscriber of {stream.topic} got {message!r:.300}")
            reader.forget_messages()
        return publisher, readers

    def provide(self, service: str) -> None:
        """Offer the service from a connection of its own."""
        provider = self.connect()
        provider.send(masked(advertise_service(service, SERVICE_TYPE)))
        self.loop.settle()
        requests = provider.keep_messages()
        tail = b',"service":"' + service.encode() + b'","values":{"sum":3},"result":true}'

        def answer() -> None:
            answers = [
                masked(b'{"op":"service_response","id":' + found[1] + tail)
                for request in requests
                if (found := ID.search(request))
            ]
            requests.clear()
            provider.send(b"".join(answers))

        provider.on_data = answer

    def check_service(self, caller: Connection, service: str) -> None:
        """Make one call whose answer is read."""
        self.loop.settle()
        answers = caller.keep_messages()
        caller.send(masked(call(service, "check", 1, 2)))
        self.loop.until(lambda: bool(answers), GRACE_SECONDS)
        caller.forget_messages()
        response = json.loads(answers[0]) if answers else None
        expected = {"op": "service_response", "id": "check", "values": {"sum": 3}, "result": True}
        if response is None or {key: response.get(key) for key in expected} != expected:
            raise WrongAnswer(f"{self._server.name}: calling {service} gave {response}")

    def sustain(
        self, keep_going: Callable[[], None], received: Callable[[], int], seconds: float
    ) -> tuple[_Moment, _Moment]:
        """Keep the load up: first to warm up, then for `seconds` between the two moments returned."""
        self._run(keep_going, WARM_UP_SECONDS)
        begin = self.moment(received())
        self._run(keep_going, seconds)
        return begin, self.moment(received())

    def _run(self, keep_going: Callable[[], None], seconds: float) -> None:
        end = time.perf_counter() + seconds
        while time.perf_counter() < end:
            keep_going()
            if not self.loop.turn(GRACE_SECONDS):
                return  # nothing came for that long: the count of what is lost will say so

    def moment(self, received: int) -> _Moment:
        return _Moment(time.perf_counter(), received, self._server.cpu_time(), cpu_time(os.getpid()))
