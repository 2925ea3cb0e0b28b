"""What is measured, what is read off each measurement, and the floor that the project sets for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from bench import load, messages
from bench.load import Latency, Throughput, Window
from bench.processes import Memory, Server

Result = Throughput | Latency | Memory

SUBSCRIBERS = 100
FEW = 4
ENCODINGS = ("none", "png", "cbor", "cbor-raw")
DEPTH = 32
LATENCY_STRETCH = 1.5
SERVICE_IN_SERVER = "/add_two_ints"
SERVICE_OF_CLIENT = "/load/add_two_ints"


@dataclass(frozen=True, slots=True)
class Case:
    """One load. `relay` says whether the relay can carry it too."""

    name: str
    run: Callable[[Server, float], Result]
    relay: bool = True


class Compared(Enum):
    """What a floor is set on."""

    RATIO = "ratio"
    """This server's value divided by the relay's."""
    DIFFERENCE = "difference"
    """This server's value minus the relay's."""
    VALUE = "value"
    """This server's value alone; the ratio is printed for information."""


@dataclass(frozen=True, slots=True)
class Floor:
    """What has to be reached: at least `bound`, or at most if `at_most`."""

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
        relay_case: the relay's case, where it is another one.
    """

    label: str
    case: str
    read: Callable[[Result], float]
    digits: int = 0
    floor: Floor | None = None
    compared: Compared = Compared.RATIO
    relay_case: str = ""


def _fan_out(
    stream: messages.Stream, subscribers: int, window: Window, compressions: Sequence[str] = ("none",)
) -> Callable[[Server, float], Result]:
    return lambda server, seconds: load.fan_out(server, stream, subscribers, window, seconds, compressions)


def _calls(service: str, depth: int, provided_here: bool) -> Callable[[Server, float], Result]:
    return lambda server, seconds: load.service_calls(server, service, depth, seconds, provided_here)


def _latency(server: Server, seconds: float) -> Result:
    return load.latency(server, seconds * LATENCY_STRETCH)


MEMORY = "memory"

CASES = (
    Case("twist 1→1", _fan_out(messages.twists(), 1, Window(512, 64))),
    Case("twist 1→100", _fan_out(messages.twists(), SUBSCRIBERS, Window(64, 8, nap=0.002))),
    Case("string", _fan_out(messages.strings(), 1, Window(2, 1))),
    Case("image", _fan_out(messages.images(), 1, Window(2, 1))),
    *(
        Case(f"scan {name}", _fan_out(messages.scans(), 1, Window(64, 8), (name,)), relay=name == "none")
        for name in ENCODINGS
    ),
    Case(f"scan 1→{FEW}", _fan_out(messages.scans(), FEW, Window(64, 8))),
    Case(f"scan 1→{SUBSCRIBERS}", _fan_out(messages.scans(), SUBSCRIBERS, Window(16, 2, nap=0.002))),
    Case(f"scan 1→{FEW} mixed", _fan_out(messages.scans(), FEW, Window(64, 8), ENCODINGS), relay=False),
    Case(
        f"scan 1→{SUBSCRIBERS} mixed",
        _fan_out(messages.scans(), SUBSCRIBERS, Window(16, 2, nap=0.002), ENCODINGS),
        relay=False,
    ),
    Case("calls in server 1", _calls(SERVICE_IN_SERVER, 1, provided_here=False), relay=False),
    Case("calls in server 32", _calls(SERVICE_IN_SERVER, DEPTH, provided_here=False), relay=False),
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
    Metric("1→1 small Twist, messages/s", "twist 1→1", _rate, floor=Floor(1.0)),
    Metric("1→1 small Twist, CPU s per 10,000", "twist 1→1", _cpu, digits=4),
    Metric("1→100 small Twist, deliveries/s", "twist 1→100", _rate, floor=Floor(2.0)),
    Metric(
        "1→100 small Twist, CPU s per 10,000", "twist 1→100", _cpu, digits=4, floor=Floor(0.5, at_most=True)
    ),
    Metric("1 MB String, messages/s", "string", _rate, floor=Floor(0.6)),
    Metric("1 MB String, CPU s per 10,000", "string", _cpu, digits=2),
    Metric("640x480 Image, messages/s", "image", _rate, floor=Floor(0.6)),
    Metric("640x480 Image, CPU s per 10,000", "image", _cpu, digits=2),
    *(
        Metric(f"1→1 LaserScan, {name}, messages/s", f"scan {name}", _rate, relay_case="scan none")
        for name in ENCODINGS
    ),
    *(
        Metric(
            f"1→{count} LaserScan, {what}, CPU s per 10,000",
            f"scan 1→{count}{mixed}",
            _cpu,
            digits=4,
            relay_case=f"scan 1→{count}",
        )
        for count in (FEW, SUBSCRIBERS)
        for what, mixed in (("JSON", ""), ("4 encodings", " mixed"))
    ),
    Metric(
        "service in the server, 1 at a time, calls/s",
        "calls in server 1",
        _rate,
        relay_case="calls of client 1",
    ),
    Metric(
        f"service in the server, {DEPTH} in flight, calls/s",
        "calls in server 32",
        _rate,
        floor=Floor(30_000),
        compared=Compared.VALUE,
        relay_case="calls of client 32",
    ),
    Metric("service of a client, 1 at a time, calls/s", "calls of client 1", _rate),
    Metric(f"service of a client, {DEPTH} in flight, calls/s", "calls of client 32", _rate),
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
