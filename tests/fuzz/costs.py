"""Cost of a message to the server: milliseconds and memory for each byte sent, by encoding.

A case repeats one small value at some place of an op until the message is large. The values come from a seed,
so that a run can be repeated; the worst that were found are kept here and played by `make test-all`.
"""

from __future__ import annotations

import gc
import json
import logging
import random
import time
import tracemalloc
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import bson
import cbor2

from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph import MemoryGraph
from rwt_interfaces.registry import Registry
from tests.core.rosbridge.recording_client import Client

SIZE: Final = 60_000
"""Bytes of one message, about."""

ENCODE: Final[Mapping[str, Callable[[Any], bytes]]] = MappingProxyType(
    {"json": lambda message: json.dumps(message).encode(), "cbor": cbor2.dumps, "bson": bson.encode}
)

PLACES: Final[Mapping[str, Callable[[list[object]], dict[str, object]]]] = MappingProxyType(
    {
        "unknown member": lambda items: {"op": "subscribe", "topic": "/a", "x": items},
        "qos": lambda items: {"op": "subscribe", "topic": "/a", "qos": {"depth": items}},
        "id": lambda items: {"op": "publish", "topic": "/a", "id": items},
        "arguments": lambda items: {"op": "call_service", "service": "/rosapi/topics", "args": items},
        "unknown field": lambda items: _publish("std_msgs/String", {"x": items}),
        "points": lambda items: _publish("geometry_msgs/Polygon", {"points": items}),
        "markers": lambda items: _publish("visualization_msgs/MarkerArray", {"markers": items}),
        "texts": lambda items: _publish("sensor_msgs/JointState", {"name": items}),
        "numbers": lambda items: _publish("std_msgs/Float64MultiArray", {"data": items}),
        "values in an item": lambda items: _publish(
            "sensor_msgs/PointCloud", {"channels": [{"values": items}]}
        ),
        "texts in an item": lambda items: _publish(
            "rcl_interfaces/ParameterEvent", {"new_parameters": [{"value": {"string_array_value": items}}]}
        ),
        "octets": lambda items: _publish("std_msgs/UInt8MultiArray", {"data": items}),
    }
)
"""Where the value stands."""

TYPES: Final = (
    "std_msgs/String", "geometry_msgs/Polygon", "visualization_msgs/MarkerArray", "sensor_msgs/JointState",
    "std_msgs/Float64MultiArray", "std_msgs/UInt8MultiArray", "sensor_msgs/PointCloud",
    "rcl_interfaces/ParameterEvent",
)  # fmt: skip
"""Topic of another subscriber."""

_NAMES: Final = ("", "a", "x", "pose", "header", "points", "color", "name", "data")
_LEAVES: Final = ("", "a", "é", "NaN", "[{", 0, 255, -1, 1 << 40, 0.1, -0.0, 1e300, True, None)


def _topic(name: str) -> str:
    return "/" + name.replace("/", "_")


def _publish(name: str, msg: dict[str, object]) -> dict[str, object]:
    return {"op": "publish", "topic": _topic(name), "type": name, "msg": msg}


@dataclass(frozen=True, slots=True)
class Case:
    """One value, where it stands, and how the message is encoded."""

    encoding: str
    place: str
    value: object

    def message(self) -> bytes:
        """The message, with the value as often as fits."""
        one = len(ENCODE[self.encoding]({"": [self.value, self.value]})) - len(
            ENCODE[self.encoding]({"": [self.value]})
        )
        return ENCODE[self.encoding](PLACES[self.place]([self.value] * (SIZE // max(1, one))))


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one case.

    Attributes:
        size: bytes sent.
        nanoseconds: of the processor, for each byte.
        memory: bytes at the same time beside the message, for each byte; what is sent on is counted.
    """

    case: Case
    size: int
    nanoseconds: float
    memory: float


def cases(seed: int) -> Iterator[Case]:
    """Values without an end, the same for the same seed."""
    chosen = random.Random(seed)
    while True:
        value = _value(chosen, 3)
        yield Case(chosen.choice(tuple(ENCODE)), chosen.choice(tuple(PLACES)), value)


def _value(chosen: random.Random, depth: int) -> object:
    kind = chosen.random()
    if depth and kind < 0.35:
        return [_value(chosen, depth - 1) for _ in range(chosen.choice((0, 0, 1, 2)))]
    if depth and kind < 0.75:
        names = chosen.sample(_NAMES, chosen.choice((0, 0, 1, 2)))
        return {name: _value(chosen, depth - 1) for name in names}
    return chosen.choice(_LEAVES)


_registry: Final = Registry()


def _server(encoding: str) -> tuple[Bridge, Client]:
    """A bridge with a client, and another that subscribes to everything that can be published."""
    bridge = Bridge(MemoryGraph(registry=_registry), Settings(bson_only_mode=encoding == "bson"))
    other, client = Client(bridge), Client(bridge)
    for name in TYPES:
        ask = {"op": "subscribe", "topic": _topic(name), "type": name}
        other.say_raw(ENCODE["bson" if encoding == "bson" else "json"](ask), binary=encoding == "bson")
    return bridge, client


def cost(case: Case) -> Cost:
    """Send the message of a case twice: to a server that is timed, and to one whose memory is watched."""
    logging.getLogger("rwt.bridge").setLevel(logging.CRITICAL)
    data = case.message()
    binary = case.encoding != "json"
    bridge, client = _server(case.encoding)
    begin = time.thread_time()
    client.say_raw(data, binary=binary)
    seconds = time.thread_time() - begin
    bridge.close()
    bridge, client = _server(case.encoding)
    gc.collect()
    tracemalloc.start()
    client.say_raw(data, binary=binary)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    bridge.close()
    return Cost(case, len(data), seconds * 1e9 / len(data), peak / len(data))


def worst(seed: int, seconds: float) -> Mapping[str, tuple[Cost, Cost]]:
    """The slowest and the largest case of each encoding that were found in that time."""
    found: dict[str, tuple[Cost, Cost]] = {}
    until = time.monotonic() + seconds
    for case in cases(seed):
        if time.monotonic() > until:
            return found
        new = cost(case)
        slowest, largest = found.get(case.encoding, (new, new))
        found[case.encoding] = (
            max(slowest, new, key=lambda each: each.nanoseconds),
            max(largest, new, key=lambda each: each.memory),
        )
    raise AssertionError("cases have no end")


KEPT: Final = (
    Case("json", "markers", {}), Case("json", "points", {}), Case("json", "numbers", -0.0),
    Case("json", "unknown member", [[]]), Case("json", "numbers", 1e300), Case("json", "qos", 1e300),
    Case("json", "arguments", [1e300]), Case("cbor", "points", []), Case("cbor", "points", {}),
    Case("cbor", "unknown field", {"": []}), Case("cbor", "markers", {}), Case("bson", "markers", {}),
    Case("bson", "points", {}),
)  # fmt: skip
"""The worst cases that runs have found, and those that were the worst before they were bounded."""

MOST_MEMORY: Final = 150
"""Bytes of memory for each byte sent that a kept case may cost."""
