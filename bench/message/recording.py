"""`python -m bench.message.recording`: what recording costs, beside the bare MCAP library in the same run.

`rwt bag record` is fed the frames that a server sends (`cbor-raw`), and the library alone the same serialised
messages; both write and compress a file. What is compared is CPU time, threads included, which other
programs on the machine disturb less than the clock. Exit code 1 when a bound is missed or a message is not in
the file.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

import anyio.lowlevel
from mcap.writer import CompressionType, Writer

from bench.traffic import messages
from rwt.extensions.recording import ChannelForm, RecordingWriter, channel_form
from rwt_client.endpoints.remote_handle import ClientConnection
from rwt_client.endpoints.remote_types import RemoteTypes
from rwt_client.endpoints.subscriptions import RawSubscription
from rwt_client.wire.session import ReconnectingSession
from rwt_graph.api import Sample
from rwt_interfaces import JAZZY, Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.messages import RawMessage
from rwt_protocol.codecs import ENCODINGS
from rwt_protocol.limits import WireLimits
from rwt_transports.background import TaskStarter

ROUNDS = 5
STAMP = 1_700_000_000_000_000_000


@dataclass(frozen=True, slots=True)
class Load:
    """Recorded messages: their number, and the maximum ratio of the costs."""

    stream: messages.Stream
    count: int
    bound: float


LOADS: Mapping[str, Load] = {
    "Twist": Load(messages.twists(), 50_000, 3.0),
    "LaserScan": Load(messages.scans(), 20_000, 3.0),
    "640x480 Image": Load(messages.images(), 200, 1.5),
}


async def _nobody(question: str, args: Mapping[str, object]) -> object:
    raise AssertionError(f"asked {question}, though every type here is standard")


def main() -> int:
    """Measure and print; 1 when a bound is missed."""
    print(f"{'message':<16}{'recording':>14}{'library alone':>16}{'ratio':>8}{'bound':>8}")
    missed = False
    for name, load in LOADS.items():
        types = RemoteTypes(_nobody)
        types.set_distro(JAZZY)
        message = types.registry.message(load.stream.type)
        payloads = [Payload.from_value(message, each) for each in load.stream.messages]
        found = [
            (_recording(load, types, message, payloads), _library(load, message, payloads))
            for _ in range(ROUNDS)
        ]
        ratio = median(ours / library for ours, library in found)
        ours, library = (median(column) * 1e6 for column in zip(*found, strict=True))
        verdict = "" if ratio <= load.bound else "  <<< above"
        missed = missed or bool(verdict)
        print(f"{name:<16}{ours:>11.1f} us{library:>13.1f} us{ratio:>7.2f}x{load.bound:>7.1f}x{verdict}")
    return int(missed)


def _recording(load: Load, types: RemoteTypes, message: MessageType, payloads: list[Payload]) -> float:
    encode = ENCODINGS["cbor-raw"].publish_encoder(load.stream.topic)
    frames = [encode(Sample(load.stream.topic, payload, STAMP, "/bench")).data for payload in payloads]
    form = channel_form(load.stream.topic, message, "ros")

    def run(path: Path) -> None:
        with RecordingWriter(path, JAZZY) as writer:
            channel = writer.add_channel(form)

            def receive(raw: RawMessage) -> None:
                stamp = raw.stamp_ns or 0
                writer.write(channel, stamp, stamp, raw.data)

            line = ReconnectingSession(None, WireLimits())
            connection = ClientConnection(line, types, TaskStarter(), anyio.lowlevel.checkpoint, None, True)
            subscription = RawSubscription(connection, load.stream.topic, receive)
            subscription.open(message, partial(types.message, message.name))
            for index in range(load.count):
                line.receive(frames[index % len(frames)], True)
                if not index % 1000:
                    time.sleep(
                        0
                    )  # The writing thread gets its turn, as it does between the reads of a socket.
        if channel.messages != load.count or writer.dropped:
            raise SystemExit(f"{load.count - channel.messages} messages were not recorded")

    return _cpu_seconds(run) / load.count


def _library(load: Load, message: MessageType, payloads: list[Payload]) -> float:
    contents = [payload.cdr() for payload in payloads]
    form = channel_form(load.stream.topic, message, "ros")

    def run(path: Path) -> None:
        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start(profile="ros2")
            channel = _registered(writer, form)
            for index in range(load.count):
                writer.add_message(channel, STAMP, contents[index % len(contents)], STAMP, index)
            writer.finish()

    return _cpu_seconds(run) / load.count


def _registered(writer: Writer, form: ChannelForm) -> int:
    schema: int = writer.register_schema(form.schema_name, form.schema_encoding, form.schema)
    return writer.register_channel(form.topic, form.message_encoding, schema, form.metadata)


def _cpu_seconds(run: Callable[[Path], None]) -> float:
    with tempfile.TemporaryDirectory() as folder:
        before = time.process_time()
        run(Path(folder) / "run.mcap")
        return time.process_time() - before


if __name__ == "__main__":
    sys.exit(main())
