"""Cases of the benchmark, their metrics, and the floors that the project sets."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from bench.traffic import load, messages
from bench.traffic.load import Latency, Throughput, Window
from bench.traffic.processes import Memory, Server

Result = Throughput | Latency | Memory

SUBSCRIBERS = 100
FEW = 4
ENCODINGS = ("none", "png", "cbor", "cbor-raw")
DEPTH = 32
LATENCY_STRETCH = 1.5
SERVICE_IN_SERVER = "/add_two_ints"
SERVICE_OF_CLIENT = "/load/add_two_ints"


class Peer(Enum):
    """Server to compare with."""

    RELAY = "relay"
    FOXGLOVE = "Foxglove's SDK"
    EARLIER = "earlier commit"
    """This project's server from another checkout, with `--against`."""


@dataclass(frozen=True, slots=True)
class Case:
    """One load, and the peers that carry it too."""

    name: str
    run: Callable[[Server, float], Result]
    peers: tuple[Peer, ...] = (Peer.RELAY,)


class Compared(Enum):
    """Value that a floor applies to."""

    RATIO = "ratio"
    """This server's value divided by the peer's."""
    DIFFERENCE = "difference"
    """This server's value minus the peer's."""
    VALUE = "value"
    """This server's value alone; the ratio is printed for information."""


@dataclass(frozen=True, slots=True)
class Floor:
    """Required value: at least `bound`, or at most if `at_most`."""

    bound: float
    at_most: bool = False

    def holds(self, value: float) -> bool:
        return value <= self.bound if self.at_most else value >= self.bound


@dataclass(frozen=True, slots=True)
class Metric:
    """One row of the table.

    Attributes:
        label: what the row is about, with its unit.
        case: name of the case it is read from.
        read: takes the number from the case's result.
        digits: decimals to print.
        floor: what has to be reached, if anything.
        compared: what `floor` is set on.
        peer: what this server's value is compared with.
        peer_case: the peer's case, where it is another one.
    """

    label: str
    case: str
    read: Callable[[Result], float]
    digits: int = 0
    floor: Floor | None = None
    compared: Compared = Compared.RATIO
    peer: Peer = Peer.RELAY
    peer_case: str = ""


def _fan_out(
    stream: messages.Stream, subscribers: int, window: Window, compressions: Sequence[str] = ("none",)
) -> Callable[[Server, float], Result]:
    return lambda server, seconds: load.fan_out(server, stream, subscribers, window, seconds, compressions)


def _calls(service: str, depth: int, provided_here: bool) -> Callable[[Server, float], Result]:
    return lambda server, seconds: load.service_calls(server, service, depth, seconds, provided_here)


def _latency(server: Server, seconds: float) -> Result:
    return load.latency(server, seconds * LATENCY_STRETCH)


@dataclass(frozen=True, slots=True)
class _Large:
    """A stream of large messages in one encoding.

    Attributes:
        label: what is sent and how it arrives.
        name: of its cases, to which the number of readers is added.
        floors: of the rate, beside the relay's of the same stream in JSON: to one reader, and to ten.
        relayed: the relay's cases, where they are others.
    """

    label: str
    name: str
    stream: messages.Stream
    floors: tuple[float, float]
    compression: str = "none"
    relayed: str = ""

    def case(self, subscribers: int) -> str:
        return _readers(self.name, subscribers)

    def metrics(self) -> Iterator[Metric]:
        for count, floor in zip(FEW_READERS, self.floors, strict=True):
            label = f"1→{count} {self.label}"
            peer_case = _readers(self.relayed or self.name, count)
            yield Metric(
                f"{label}, deliveries/s",
                self.case(count),
                _rate,
                floor=Floor(floor),
                peer_case=peer_case,
            )
            yield Metric(f"{label}, CPU s per 10,000", self.case(count), _cpu, digits=2, peer_case=peer_case)


def _readers(name: str, subscribers: int) -> str:
    return f"{name} 1→{subscribers}"


FEW_READERS = (1, 10)
LARGE = (
    _Large("1 MB String", "string", messages.strings(), (0.9, 0.9)),
    _Large("1 MB String → cbor", "string cbor", messages.strings(), (0.9, 1.2), "cbor", "string"),
    _Large("640x480 Image", "image", messages.images(), (1.0, 1.0)),
    _Large("640x480 Image without a stamp", "image unstamped", messages.unstamped_images(), (0.9, 0.9)),
    _Large("640x480 Image → cbor", "image cbor", messages.images(), (1.0, 1.0), "cbor", "image"),
    _Large("640x480 Image → cbor-raw", "image cbor-raw", messages.images(), (1.0, 1.0), "cbor-raw", "image"),
)

MEMORY = "memory"
EVERY_PEER = (Peer.RELAY, Peer.FOXGLOVE)

CASES = (
    Case("twist 1→1", _fan_out(messages.twists(), 1, Window(512, 64)), EVERY_PEER),
    *(
        Case(
            f"twist 1→{SUBSCRIBERS}{suffix}",
            _fan_out(messages.twists(), SUBSCRIBERS, Window(size, min(size, 8), nap=0.002)),
            EVERY_PEER,
        )
        for suffix, size in (("", 64), (" by 8", 8), (" by 1", 1))
    ),
    *(
        Case(
            large.case(subscribers),
            _fan_out(large.stream, subscribers, Window(2, 1), (large.compression,)),
            peers=(Peer.RELAY,) if large.compression == "none" else (),
        )
        for large in LARGE
        for subscribers in FEW_READERS
    ),
    *(
        Case(
            f"scan {name}",
            _fan_out(messages.scans(), 1, Window(64, 8), (name,)),
            peers=(Peer.RELAY,) if name == "none" else (),
        )
        for name in ENCODINGS
    ),
    Case(f"scan 1→{FEW}", _fan_out(messages.scans(), FEW, Window(64, 8))),
    Case(f"scan 1→{SUBSCRIBERS}", _fan_out(messages.scans(), SUBSCRIBERS, Window(16, 2, nap=0.002))),
    Case(f"scan 1→{FEW} mixed", _fan_out(messages.scans(), FEW, Window(64, 8), ENCODINGS), peers=()),
    Case(
        f"scan 1→{SUBSCRIBERS} mixed",
        _fan_out(messages.scans(), SUBSCRIBERS, Window(16, 2, nap=0.002), ENCODINGS),
        peers=(),
    ),
    Case("calls in server 1", _calls(SERVICE_IN_SERVER, 1, provided_here=False), peers=()),
    Case("calls in server 32", _calls(SERVICE_IN_SERVER, DEPTH, provided_here=False), peers=()),
    Case("calls of client 1", _calls(SERVICE_OF_CLIENT, 1, provided_here=True)),
    Case("calls of client 32", _calls(SERVICE_OF_CLIENT, DEPTH, provided_here=True)),
    Case("latency", _latency),
)


def _rate(result: Result) -> float:
    assert isinstance(result, Throughput)
    return result.rate


def _cpu(result: Result) -> float:
    assert isinstance(result, Throughput)
    return result.cpu_per_10k


def _percentile(percent: float) -> Callable[[Result], float]:
    def read(result: Result) -> float:
        assert isinstance(result, Latency)
        return result.percentile(percent)

    return read


def _memory_now(result: Result) -> float:
    assert isinstance(result, Memory)
    return result.now


def _memory_peak(result: Result) -> float:
    assert isinstance(result, Memory)
    return result.peak


METRICS = (
    Metric("1→1 small Twist, messages/s", "twist 1→1", _rate, floor=Floor(1.3)),
    Metric("1→1 small Twist, CPU s per 10,000", "twist 1→1", _cpu, digits=4),
    Metric("1→100 small Twist, deliveries/s", "twist 1→100", _rate, floor=Floor(2.0)),
    Metric(
        "1→100 small Twist, CPU s per 10,000", "twist 1→100", _cpu, digits=4, floor=Floor(0.5, at_most=True)
    ),
    *(
        Metric(
            f"1→{SUBSCRIBERS} small Twist, {size} on their way, CPU s per 10,000",
            f"twist 1→{SUBSCRIBERS} by {size}",
            _cpu,
            digits=4,
        )
        for size in (8, 1)
    ),
    *(
        Metric(
            f"{label}, beside {Peer.FOXGLOVE.value}, CPU s per 10,000",
            case,
            _cpu,
            digits=4,
            floor=floor,
            peer=Peer.FOXGLOVE,
        )
        for label, case, floor in (
            ("1→1 small Twist", "twist 1→1", None),
            (f"1→{SUBSCRIBERS} small Twist", f"twist 1→{SUBSCRIBERS}", Floor(1.0, at_most=True)),
            ("the same, 8 on their way", f"twist 1→{SUBSCRIBERS} by 8", Floor(1.0, at_most=True)),
            ("the same, 1 on its way", f"twist 1→{SUBSCRIBERS} by 1", Floor(1.0, at_most=True)),
        )
    ),
    *(metric for large in LARGE for metric in large.metrics()),
    *(
        Metric(f"1→1 LaserScan, {name}, messages/s", f"scan {name}", _rate, peer_case="scan none")
        for name in ENCODINGS
    ),
    *(
        Metric(
            f"1→{count} LaserScan, {what}, CPU s per 10,000",
            f"scan 1→{count}{mixed}",
            _cpu,
            digits=4,
            peer_case=f"scan 1→{count}",
        )
        for count in (FEW, SUBSCRIBERS)
        for what, mixed in (("JSON", ""), ("4 encodings", " mixed"))
    ),
    Metric(
        "service in the server, 1 at a time, calls/s",
        "calls in server 1",
        _rate,
        peer_case="calls of client 1",
    ),
    Metric(
        f"service in the server, {DEPTH} in flight, calls/s",
        "calls in server 32",
        _rate,
        floor=Floor(30_000),
        compared=Compared.VALUE,
        peer_case="calls of client 32",
    ),
    Metric("service of a client, 1 at a time, calls/s", "calls of client 1", _rate),
    Metric(f"service of a client, {DEPTH} in flight, calls/s", "calls of client 32", _rate, floor=Floor(0.9)),
    *(
        Metric(f"service of a client, {what}, CPU s per 10,000", case, _cpu, digits=4)
        for what, case in (("1 at a time", "calls of client 1"), (f"{DEPTH} in flight", "calls of client 32"))
    ),
    Metric(
        f"latency at {load.LATENCY_HZ} Hz, p50 ms",
        "latency",
        _percentile(50),
        digits=3,
        floor=Floor(0.1, at_most=True),
        compared=Compared.DIFFERENCE,
    ),
    Metric(
        f"latency at {load.LATENCY_HZ} Hz, p99 ms",
        "latency",
        _percentile(99),
        digits=3,
        compared=Compared.DIFFERENCE,
    ),
    Metric(
        "memory after the load, MB",
        MEMORY,
        _memory_now,
        digits=1,
        floor=Floor(80.0, at_most=True),
        compared=Compared.VALUE,
    ),
    Metric("memory at its peak, MB", MEMORY, _memory_peak, digits=1),
)
