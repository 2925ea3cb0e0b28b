"""Channels of clients in each encoding, and their rejection."""

from __future__ import annotations

import json
import logging
import struct
from typing import Any

import pytest

from rwt import Settings
from rwt.rosbridge.bridge import Bridge
from rwt_graph import MemoryGraph, Node
from rwt_graph.api import Sample
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.registry import Registry
from rwt_participant.handles import Publisher
from rwt_transports.scheduler import MESSAGES
from tests.conftest import START_NS
from tests.core.rosbridge.recording_client import Client
from tests.core.rosbridge.test_turns import BusyClock
from tests.extensions.foxglove.conftest import MakeGateway, gateway_of, guest
from tests.extensions.foxglove.viewer import Viewer

HELLO = bytes.fromhex("00010000 06000000") + b"hello\0"


def _listen(graph: MemoryGraph, topic: str = "/t", type: str = "std_msgs/String") -> list[Any]:
    heard: list[Any] = []
    Node(graph, "listener").subscribe(topic, heard.append, type=type)
    return heard


@pytest.mark.parametrize(("encoding", "payload"), [("cdr", HELLO), ("json", b'{"data": "hello"}')])
def test_a_message_reaches_the_graph_and_clients_of_other_protocols(
    graph: MemoryGraph, viewer: Viewer, encoding: str, payload: bytes
) -> None:
    heard = _listen(graph)
    bridge = Client(Bridge(graph, Settings()))
    bridge.say("subscribe", topic="/t", type="std_msgs/String")
    viewer.advertise("/t", "std_msgs/msg/String", encoding)
    viewer.publish(payload)
    assert [each.data for each in heard] == ["hello"]
    assert bridge.heard_of("/t") == [{"data": "hello"}]
    counts = viewer.client.graph.counters.topics["/t"]
    assert (counts.received, counts.received_bytes) == (1, len(payload))
    viewer.say("unadvertise", channelIds=[1])
    viewer.heard()
    viewer.publish(payload)
    assert viewer.statuses() == ["message data: this client advertises no channel 1"]
    assert len(heard) == 1


def test_ros_1_takes_its_own_form() -> None:
    graph = MemoryGraph(Registry(NOETIC), SimulatedClock(START_NS))
    viewer = Viewer(gateway_of(graph, distro="noetic"))
    heard = _listen(graph)
    viewer.advertise("/t", "std_msgs/String", "ros1")
    viewer.publish(b"\5\0\0\0hello")
    viewer.advertise("/t", "std_msgs/String", "cdr", id=2)
    assert "expected ros1 or json" in str(viewer.statuses())
    assert [each.data for each in heard] == ["hello"]


def test_headers_without_a_stamp_get_one(graph: MemoryGraph, viewer: Viewer) -> None:
    heard = _listen(graph, type="geometry_msgs/PoseStamped")
    viewer.advertise("/t", "geometry_msgs/PoseStamped")
    viewer.publish(b'{"pose": {"position": {"x": 1}}}')
    assert heard[0].pose.position.x == 1.0
    assert heard[0].header.stamp.sec == START_NS // 10**9


def test_octets_do_not_change_with_the_buffer_that_they_came_in(graph: MemoryGraph, viewer: Viewer) -> None:
    kept: list[Sample] = []
    graph.participant("/l").subscribe(
        "/t", lambda sample: kept.append(sample.detach()), graph.registry.message("std_msgs/String")
    )
    viewer.advertise("/t", "std_msgs/String", "cdr")
    frame = bytearray(struct.pack("<BI", 1, 1) + HELLO)
    viewer.received += 1
    viewer.endpoint.receive(frame, True)  # type: ignore[arg-type]  # a buffer that its transport reuses
    frame[:] = b"\xff" * len(frame)
    assert kept[0].payload.json() == b'{"data":"hello"}'


@pytest.mark.parametrize(
    ("type", "encoding", "words"),
    [
        ("std_msgs/String", "protobuf", "encoding 'protobuf': expected cdr or json"),
        ("std_msgs/String", "ros1", "expected cdr or json"),
        ("no_msgs/None", "json", "no_msgs/None"),
        ("std_msgs/Int32", "json", "already established with type std_msgs/msg/String"),
        ("", "json", '"" is not a type name'),
    ],
)
def test_a_channel_that_cannot_be_is_refused(
    talker: Publisher, viewer: Viewer, type: str, encoding: str, words: str
) -> None:
    viewer.advertise("/t", type, encoding)
    (status,) = viewer.statuses()
    assert words in status
    viewer.publish(b"{}")
    assert "advertises no channel 1" in str(viewer.statuses())
    viewer.advertise("/t", "std_msgs/String")  # The id is free.
    assert viewer.statuses() == []
    viewer.advertise("/u", "std_msgs/String")
    assert viewer.statuses() == ["advertise: channel 1 is advertised already; take another id"]


@pytest.mark.parametrize(
    ("encoding", "payload", "words"),
    [
        ("cdr", b"", "message data on /t"),
        ("cdr", HELLO[:-3], "message data on /t"),
        ("json", b'{"data": 5}', "data: expected string"),
        ("json", b"{", "message data on /t"),
        ("json", b'{"other": 1}', "other"),
        ("json", b"[" * 100_000, "message data on /t"),
    ],
)
def test_a_message_that_does_not_fit_is_refused(
    graph: MemoryGraph, viewer: Viewer, encoding: str, payload: bytes, words: str
) -> None:
    heard = _listen(graph)
    viewer.heard()
    viewer.advertise("/t", "std_msgs/String", encoding)
    viewer.publish(payload)
    (status,) = viewer.statuses()
    assert words in status
    assert heard == []


def test_rights_and_bounds_hold_for_what_is_published(make: MakeGateway, graph: MemoryGraph) -> None:
    viewer = Viewer(make(**guest(publish=["/open*"]), limits={"advertisements": 1}))
    viewer.advertise("/secret", "std_msgs/String")
    assert "roles.guest.publish" in str(viewer.statuses())
    assert graph.topic("/secret") is None
    viewer.advertise("/open", "std_msgs/String")
    viewer.advertise("/open_too", "std_msgs/String", id=2)
    assert "limits.advertisements" in str(viewer.statuses())
    viewer.say("unadvertise", channelIds=[2])
    assert viewer.statuses() == ["unadvertise: this client advertises no channel 2"]


def test_who_sends_too_many_messages_has_to_go(make: MakeGateway) -> None:
    viewer = Viewer(make(limits={"messages_per_second": 1, "messages_burst": 3}))
    for _ in range(5):
        viewer.say("unsubscribeConnectionGraph")
    assert (viewer.close_code, "limits.messages_per_second" in viewer.close_reason) == (1008, True)


def test_a_mistake_of_the_server_is_logged_and_reveals_nothing(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(viewer.client.publications, "advertise", lambda channel: 1 / 0)
    with caplog.at_level(logging.ERROR, "rwt.bridge"):
        viewer.advertise("/t", "std_msgs/String")
    assert viewer.statuses() == ["internal error"]
    assert any(record.exc_info for record in caplog.records)


# -- turns -------------------------------------------------------------------------------------------------


def test_what_is_beyond_the_share_of_a_turn_waits_for_the_next() -> None:
    clock = BusyClock()
    graph = MemoryGraph(clock=clock)
    viewer = Viewer(gateway_of(graph))
    heard: list[str] = []

    def work(sample: Sample) -> None:
        clock.worked += 0.6 * MESSAGES.share
        heard.append(str(sample.payload.json()))

    graph.participant("/l").subscribe("/t", work, graph.registry.message("std_msgs/String"))
    viewer.advertise("/t", "std_msgs/String")
    frame = struct.pack("<BI", 1, 1) + b'{"data":"x"}'
    for _ in range(6):  # In one read of the connection.
        viewer.endpoint.receive(frame, True)
    assert len(heard) == 2
    for _ in range(8):
        clock.advance(0.0)
    assert len(heard) == 6


def test_a_text_about_many_things_is_done_in_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = BusyClock()
    viewer = Viewer(gateway_of(MemoryGraph(clock=clock)))
    original = viewer.client.subscriptions.unsubscribe

    def work(id: int) -> None:
        clock.worked += 0.6 * MESSAGES.share
        original(id)

    monkeypatch.setattr(viewer.client.subscriptions, "unsubscribe", work)
    viewer.say("unsubscribe", subscriptionIds=list(range(10)))
    viewer.say("fetchAsset", uri="package://a/b", requestId=1)
    assert viewer.heard() == []
    for _ in range(20):
        clock.advance(0.0)
    (status,) = viewer.statuses()
    assert "fetchAsset" in status


def test_long_json_is_checked_in_steps_and_published_once(graph: MemoryGraph, viewer: Viewer) -> None:
    heard = _listen(graph, type="nav_msgs/Path")
    viewer.heard()
    viewer.advertise("/t", "nav_msgs/Path")
    poses = [{"pose": {"position": {"x": float(number)}}} for number in range(4000)]
    viewer.publish(json.dumps({"poses": poses}).encode())
    clock = graph.clock
    assert isinstance(clock, SimulatedClock)
    for _ in range(200):
        clock.advance(0.0)
    assert [len(each.poses) for each in heard] == [4000]
    assert viewer.statuses() == []
