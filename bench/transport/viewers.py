"""`python -m bench.transport.viewers`: Foxglove's protocol here and at the server of Foxglove's SDK.

One client publishes in CDR, and so many viewers have subscribed. Both servers speak the same protocol, so the
load sends both the same bytes but for the ids of channels. The SDK hands a message on unseen; this server
checks it against its type. What counts is deliveries in a second of the server's CPU time, which other
programs on the machine change little.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import Final

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from bench.traffic import messages
from bench.traffic.dialects import WrongAnswer
from bench.traffic.load import Throughput, Window, fan_out
from bench.traffic.messages import Stream
from bench.traffic.processes import Server
from bench.traffic.wire import BINARY, masked
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

REGISTRY: Final = Registry()
SUBPROTOCOL: Final = "foxglove.sdk.v1"
_DELIVERY: Final = struct.Struct("<BIQ")

OURS: Final = """
import sys
from functools import partial
from rwt import Server

server = Server("ws://127.0.0.1:0", nodes=())
server.node("robot").subscribe(sys.argv[1], lambda message: None, type=sys.argv[2])
server.run(announce=partial(print, flush=True))
"""


class FoxgloveInCdr:
    """Foxglove's protocol with messages in CDR, as viewers of ROS 2 get them.

    Args:
        channel: the id of the stream's channel.
        ids: of subscriptions, in turn for the viewers.
    """

    subprotocol = SUBPROTOCOL

    def __init__(self, channel: int, ids: Iterator[int]) -> None:
        self._channel = channel
        self._ids = ids

    def advertise(self, stream: Stream) -> bytes:
        type = REGISTRY.message(stream.type)
        channel = {
            "id": 1,
            "topic": stream.topic,
            "encoding": "cdr",
            "schemaName": REGISTRY.type_name(type),
            "schemaEncoding": "ros2msg",
            "schema": REGISTRY.full_text(type),
        }
        return _text(op="advertise", channels=[channel])

    def subscribe(self, stream: Stream, compression: str) -> bytes:
        return _text(op="subscribe", subscriptions=[{"id": next(self._ids), "channelId": self._channel}])

    def publish(self, stream: Stream, message: Mapping[str, object]) -> bytes:
        payload = Payload.from_value(REGISTRY.message(stream.type), message).cdr()
        return masked(struct.pack("<BI", 1, 1) + payload, BINARY)

    def delivered(self, stream: Stream, data: bytes, compression: str) -> object:
        if len(data) <= _DELIVERY.size or data[0] != 1:
            raise WrongAnswer(f"a subscriber of {stream.topic} got {data[:300]!r}")
        payload = data[_DELIVERY.size :]
        if payload != Payload.from_value(REGISTRY.message(stream.type), stream.messages[0]).cdr():
            raise WrongAnswer(f"a subscriber of {stream.topic} got other bytes than were sent")
        return stream.messages[0]


def _text(**op: object) -> bytes:
    return masked(json.dumps(op, separators=(",", ":")).encode())


def announced_channel(client: ClientConnection, stream: Stream) -> int:
    """The id under which a server announces the channel of a stream."""
    while True:
        said = client.recv(timeout=20)
        for channel in json.loads(said).get("channels", ()) if isinstance(said, str) else ():
            if channel["topic"] == stream.topic:
                return int(channel["id"])


def here(stream: Stream) -> Server:
    """This server, with a robot that listens to the stream."""
    arguments = ["-c", OURS, stream.topic, stream.type]
    return Server("this server", arguments)


def measured(
    server: Server, stream: Stream, viewers: int, window: Window, ids: Iterator[int], seconds: float
) -> Throughput:
    """Measure a server after its clients know the channel, whose id changes when all have left."""
    with connect(_url(server), subprotocols=[Subprotocol(SUBPROTOCOL)], max_size=None) as watcher:
        channel = announced_channel(watcher, stream)
        server.dialect = FoxgloveInCdr(channel, ids)
        return fan_out(server, stream, viewers, window, seconds)


def _url(server: Server) -> str:
    return f"ws://{server.host}:{server.port}"


def the_sdk(stream: Stream) -> Server:
    """The server of Foxglove's SDK, with a channel for the stream."""
    arguments = ["-m", "bench.peers.foxglove_sdk", stream.topic, stream.type]
    return Server("Foxglove's SDK", arguments)


CASES: Final[Mapping[str, tuple[Stream, int, Window, float]]] = {
    "1→100 small Twist": (messages.twists(), 100, Window(64, 8, nap=0.002), 1.5),
    "1→100 small Twist, 8 on their way": (messages.twists(), 100, Window(8, 8, nap=0.002), 1.5),
    "1→100 small Twist, 1 on its way": (messages.twists(), 100, Window(1, 1, nap=0.002), 0.9),
    "1→100 small Twist, each viewer with an id of its own": (
        messages.twists(),
        100,
        Window(64, 8, nap=0.002),
        1.0,
    ),
    "1→10 640x480 Image": (messages.images(), 10, Window(2, 1), 0.8),
    "1→10 1 MB String": (messages.strings(), 10, Window(2, 1), 0.8),
}
"""By name: what is sent, to how many, how it is sent, and the floor of the ratio. Viewers count their
subscriptions from the same number on, so those with one layout share frames; ids that differ are put into the
gaps of what all share."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.transport.viewers", description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="turns of each server (default 3)")
    parser.add_argument("--seconds", type=float, default=1.0, help="per load (default 1)")
    parser.add_argument("--only", metavar="TEXT", default="", help="only the cases whose name contains TEXT")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a floor is missed")
    options = parser.parse_args(argv)
    missed = False
    print("deliveries in a second of the server's CPU time, median of the rounds\n")
    print("| case | this server | Foxglove's SDK | ratio | floor |\n|---|---|---|---|---|")
    for name, (stream, viewers, window, floor) in CASES.items():
        if options.only not in name:
            continue
        with ExitStack() as stack:
            servers = [here(stream), the_sdk(stream)]
            for server in servers:
                stack.callback(server.stop)
            found: list[list[Throughput]] = [[], []]
            for _ in range(options.rounds):
                for server, results in zip(servers, found, strict=True):
                    ids = itertools.count(1) if "of its own" in name else itertools.repeat(1)
                    results.append(measured(server, stream, viewers, window, ids, options.seconds))
        ours, theirs = (statistics.median(each.count / each.cpu for each in results) for results in found)
        lost = sum(each.lost for each in found[0])
        missed = missed or ours / theirs < floor or lost > 0
        note = f" ({lost} lost)" if lost else ""
        print(f"| {name}{note} | {ours:,.0f} | {theirs:,.0f} | {ours / theirs:.2f} | {floor} |", flush=True)
    return int(options.check and missed)


if __name__ == "__main__":
    sys.exit(main())
