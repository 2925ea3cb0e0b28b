"""Robots that the tests of recordings record and compare."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mcap.reader import make_reader

from rwt.extensions.recording import (
    Encoding,
    RecordingOptions,
    RecordingWriter,
    TopicSelection,
    channel_form,
    record_graph,
)
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces import DISTROS, Registry

START_NS = 1_700_000_000_123_456_789

OWN = TopicSelection(exclude=("/rosout", "/parameter_events", "/clock"), services=True, actions=True)

Row = tuple[str, str, int, int, int, bytes]


def graph_at(start_ns: int = START_NS, distro: str = "jazzy") -> tuple[MemoryGraph, SimulatedClock]:
    clock = SimulatedClock(start_ns)
    return MemoryGraph(Registry(DISTROS[distro]), clock), clock


def record_robot(path: Path, distro: str = "jazzy", encoding: Encoding = "ros", messages: int = 20) -> None:
    """A recording of a map that was there before, and of two topics at uneven times."""
    graph, clock = graph_at(distro=distro)
    with Node(graph, "robot") as node:
        node.advertise("/map_name", "std_msgs/String", latch=True).publish({"data": "hall"})
        clock.advance(3.5)
        odom = node.advertise("/odom", "nav_msgs/Odometry")
        scan = node.advertise("/camera", "sensor_msgs/Image")
        with record_graph(graph, path, OWN, RecordingOptions(encoding)):
            for number in range(messages):
                clock.advance(0.033_333_333 + number * 1e-9)
                odom.publish({"pose": {"pose": {"position": {"x": number / 3, "y": float("nan")}}}})
                if number % 4 == 0:
                    pixels = bytes(range(number, number + 12))
                    scan.publish({"height": 2, "width": 2, "step": 6, "encoding": "rgb8", "data": pixels})
        odom.publish({})  # After the recording.


def record_seconds(path: Path, start_ns: int = START_NS) -> None:
    """A recording of six seconds, with a number each."""
    graph, clock = graph_at(start_ns)
    topic = Node(graph, "robot").advertise("/n", "std_msgs/Int32")
    with record_graph(graph, path):
        for number in range(6):
            topic.publish({"data": number})
            clock.advance(1.0)


def record_chunks(path: Path) -> None:
    """A recording of three chunks without compression; the texts are `AAA…` at 0 ns to `III…` at 8 ns."""
    string = Registry(DISTROS["jazzy"]).message("std_msgs/String")
    with RecordingWriter(path, DISTROS["jazzy"], RecordingOptions(compression="none")) as writer:
        channel = writer.add_channel(channel_form("/text", string, "ros"))
        for number in range(9):
            text = string.struct(data=chr(65 + number) * 399_999)
            writer.write(channel, number, number, string.to_cdr(text))


def rows(path: Path) -> list[Row]:
    """Every message of an MCAP file, as an independent reader reads it."""
    with path.open("rb") as file:
        found = make_reader(file).iter_messages()
        return [
            (
                channel.topic,
                channel.metadata.get("ros_type") or (schema.name if schema else ""),
                each.log_time,
                each.publish_time,
                each.sequence,
                each.data,
            )
            for schema, channel, each in found
        ]


def of_topic(found: Iterable[Row], topic: str) -> list[Row]:
    return [row for row in found if row[0] == topic]
