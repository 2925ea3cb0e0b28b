"""Recording over a server in the same process: lost connections, times, what is noted of late joiners."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import anyio
import pytest

from rwt import Settings
from rwt.extensions.recording import (
    Encoding,
    Recorder,
    RecordingOptions,
    RecordingWriter,
    TopicSelection,
    open_recording,
)
from rwt.extensions.recording.channels import KEPT
from rwt.extensions.recording.recorder import EARLIER_NS
from rwt.rosapi import Rosapi
from rwt.rosbridge import Bridge
from rwt_client import ConnectionLost, Robot, connect
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from tests.core.client.worlds import AT_ONCE
from tests.waiting import until

pytestmark = pytest.mark.anyio
START = 1_700_000_000_000_000_000
OWN = TopicSelection(
    exclude=("/rosout", "/parameter_events", "/client_count", "/connected_clients", "/clock")
)


@dataclass
class Recorded:
    """A robot in simulated time, and what records it."""

    clock: SimulatedClock
    node: Node
    robot: Robot
    recorder: Recorder
    sinks: list[Sink]


@asynccontextmanager
async def recorded(path: Path, encoding: Encoding = "ros") -> AsyncIterator[Recorded]:
    clock = SimulatedClock(START)
    sinks: list[Sink] = []
    async with MemoryGraph(clock=clock) as graph:
        bridge = Bridge(graph, Settings())

        def accept(sink: Sink, peer: PeerInfo) -> Endpoint:
            sinks.append(sink)
            return bridge.accept(sink, peer)

        with Rosapi(graph), Node(graph, "robot") as node:
            async with connect(accept, reconnect=AT_ONCE) as robot:
                options = RecordingOptions(encoding)
                with Recorder(
                    robot,
                    RecordingWriter(path, graph.distro, options),
                    OWN,
                    offered_qos=lambda name: (KEPT,) if name == "/named" else None,
                ) as recorder:
                    yield Recorded(clock, node, robot, recorder, sinks)


@pytest.mark.parametrize("encoding", ["ros", "json"])
async def test_what_was_kept_is_logged_first_and_not_again_after_a_gap(
    path: Path, encoding: Encoding
) -> None:
    async with recorded(path, encoding) as here:
        here.node.advertise("/map_name", "std_msgs/String", latch=True).publish({"data": "hall"})
        count = here.node.advertise("/count", "std_msgs/Int32")
        here.clock.advance(EARLIER_NS / 1e9 + 1)
        await here.recorder.look()
        writer = here.recorder.writer
        await until(lambda: writer.messages == 1)
        here.sinks[-1].close(1001, "going")
        await until(lambda: len(here.sinks) == 2 and here.robot.connected)
        here.clock.advance(1.0)
        await until(lambda: count.subscriber_count == 1)
        count.publish({"data": 7})
        await until(lambda: writer.messages == 2)
    began = START + EARLIER_NS + 10**9
    with open_recording([path]) as recording:
        found = [(each.topic, each.publish_time, each.log_time) for each in recording.messages()]
        assert found == [("/map_name", START, began), ("/count", began + 10**9, began + 10**9)]
        kept = {topic.name: [qos.durability.value for qos in topic.offered_qos] for topic in recording.topics}
    assert kept == {"/count": [], "/map_name": ["transient_local"]}


async def test_topics_are_found_later_and_may_be_said_to_be_kept(path: Path) -> None:
    async with recorded(path) as here:
        await here.recorder.look()
        assert here.recorder.topics == 0
        named = here.node.advertise("/named", "std_msgs/String")
        await here.recorder.look()
        await here.recorder.look()
        assert here.recorder.topics == 1
        await until(lambda: named.subscriber_count == 1)
        named.publish({"data": "here"})
        await until(lambda: here.recorder.writer.messages == 1)
        here.recorder.stop()
        await until(lambda: named.subscriber_count == 0)
    with open_recording([path]) as recording:
        assert recording.topics[0].offered_qos[0].depth == 1


async def test_a_look_without_a_connection_fails_at_once(tmp_path: Path) -> None:
    async with recorded(tmp_path / "run.mcap") as here:
        here.sinks[-1].close(1001, "going")
        with anyio.fail_after(10), pytest.raises(ConnectionLost):
            await here.recorder.look()
