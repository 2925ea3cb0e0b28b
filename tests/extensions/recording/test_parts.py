"""Choosing topics, quality of service as files note it, types of a robot's own, and what is missing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rwt.extensions.recording import (
    Encoding,
    ExtraMissing,
    RecordingOptions,
    RecordingWriter,
    TopicSelection,
    channel_form,
    errors,
    open_recording,
    record_graph,
)
from rwt.extensions.recording.channels import combined, qos_text, read_offered_qos
from rwt.extensions.recording.playback import Player
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces import JAZZY, NOETIC, Payload, Registry
from rwt_participant.qos import LATCHED, Durability, History, QoS, Reliability
from tests.extensions.recording.robots import OWN, graph_at, rows


@pytest.mark.parametrize(
    ("selection", "taken"),
    [
        (TopicSelection(), "/odom /camera/raw"),
        (TopicSelection(topics=("/camera/*", "odom")), "/odom /camera/raw"),
        (TopicSelection(exclude=("*/raw",)), "/odom"),
        (TopicSelection(topics=("camera/*",), exclude=("camera/raw",)), ""),
        (TopicSelection(services=True), "/odom /camera/raw /add/_service_event"),
        (TopicSelection(topics=("/add/_service_event",)), "/add/_service_event"),
        (TopicSelection(topics=("/add/*",)), ""),
        (
            TopicSelection(actions=True),
            "/odom /camera/raw /go/_action/status /go/_action/send_goal/_service_event",
        ),
    ],
)
def test_which_topics_are_taken(selection: TopicSelection, taken: str) -> None:
    names = (
        "/odom", "/camera/raw", "/add/_service_event", "/go/_action/status",
        "/go/_action/send_goal/_service_event",
    )  # fmt: skip
    assert [name for name in names if selection.takes(name)] == taken.split()


PROFILES = st.builds(
    QoS,
    history=st.sampled_from(History),
    depth=st.integers(0, 1000),
    reliability=st.sampled_from([Reliability.RELIABLE, Reliability.BEST_EFFORT]),
    durability=st.sampled_from([Durability.VOLATILE, Durability.TRANSIENT_LOCAL]),
)


@given(st.lists(PROFILES, max_size=4).map(tuple))
def test_offered_profiles_read_back(profiles: tuple[QoS, ...]) -> None:
    assert read_offered_qos({"offered_qos_profiles": qos_text(profiles)}) == profiles


def test_profiles_in_words_are_read_as_newer_versions_of_rosbag2_write_them() -> None:
    text = (
        "- history: keep_last\n  depth: 1\n  reliability: best_effort\n  durability: transient_local\n"
        "  deadline:\n    sec: 9223372036\n    nsec: 854775807\n- history: keep_all\n  depth: 0\n"
    )
    first = QoS(depth=1, reliability=Reliability.BEST_EFFORT, durability=Durability.TRANSIENT_LOCAL)
    assert read_offered_qos({"offered_qos_profiles": text}) == (first, QoS(history=History.KEEP_ALL, depth=0))
    assert read_offered_qos({"latching": "1"}) == (LATCHED,)


@given(st.text(alphabet="- history:depth0129\n reliablydu_'\"", max_size=200))
@example("- depth: 99999999999999999999999\n")
@example("- depth: -1\n  durability: 77\n")
def test_whatever_is_noted_there_are_profiles(text: str) -> None:
    for profile in read_offered_qos({"offered_qos_profiles": text}):
        assert 0 <= profile.depth <= 1_000_000


def test_one_publisher_keeps_what_several_kept() -> None:
    assert combined(()) == QoS()
    assert combined((QoS(depth=3),)) == QoS(depth=3)
    assert combined((LATCHED, QoS(), LATCHED)) == QoS(depth=2, durability=Durability.TRANSIENT_LOCAL)
    kept = QoS(History.KEEP_ALL, durability=Durability.TRANSIENT_LOCAL)
    assert combined((kept,)).history is History.KEEP_ALL


@pytest.mark.parametrize("encoding", ["ros", "json"])
@pytest.mark.parametrize("distro", [JAZZY, NOETIC], ids=["jazzy", "noetic"])
def test_a_type_of_the_robots_own_plays_without_its_definition_at_hand(
    path: Path, distro: object, encoding: Encoding
) -> None:
    graph, _ = graph_at(distro="noetic" if distro is NOETIC else "jazzy")
    graph.registry.add_text("Cell[] cells\nuint8 FULL=1", "my_robot/Battery")
    graph.registry.add_text("float64 volts\nstring name", "my_robot/Cell")
    with Node(graph, "robot") as node:
        battery = node.advertise("/battery", "my_robot/Battery")
        with record_graph(graph, path, OWN, RecordingOptions(encoding)):
            battery.publish({"cells": [{"volts": 3.5, "name": "left"}]})
    heard: list[Any] = []
    with open_recording([path]) as recording:
        clock = SimulatedClock(recording.start_ns)
        fresh = MemoryGraph(Registry(recording.distro), clock)
        with Player(fresh, recording), Node(fresh, "app") as node:
            node.subscribe("/battery", lambda message: heard.extend(message.cells))
            clock.advance(0.0)
        assert fresh.registry.message("my_robot/Battery").definition.constants[0].name == "FULL"
    assert [(each.volts, each.name) for each in heard] == [(3.5, "left")]


def test_calls_of_a_service_of_the_robots_own_are_answered(path: Path) -> None:
    registry = Registry(JAZZY)
    registry.add_text("int64 level\n---\nbool done", "my_robot/SetLevel", "srv")
    event = registry.message("my_robot/SetLevel_Event")
    with RecordingWriter(path, JAZZY) as writer:
        channel = writer.add_channel(channel_form("/level/_service_event", event, "ros"))
        for step, content in ((1, {"request": [{"level": 4}]}), (2, {"response": [{"done": True}]})):
            told = {"info": {"event_type": step, "sequence_number": 7}, **content}
            writer.write(channel, step, step, Payload.from_value(event, told).cdr())
    with open_recording([path]) as recording:
        graph = MemoryGraph(clock=SimulatedClock(recording.start_ns))
        with Player(graph, recording):
            found = graph.service("/level")
            assert found is not None
            assert graph.registry.type_name(found.type) == "my_robot/srv/SetLevel"
            assert graph.registry.type_name(graph.registry.message("my_robot/SetLevel_Event")) == (
                "my_robot/srv/SetLevel_Event"
            )


def test_a_topic_that_changes_its_type_has_two_channels(path: Path) -> None:
    graph, clock = graph_at()
    with Node(graph, "robot") as node, record_graph(graph, path, OWN):
        for kind in ("std_msgs/Int32", "std_msgs/Float64"):
            with node.advertise("/value", kind) as value:
                clock.advance(0.5)
                value.publish({"data": 1})
            clock.advance(0.5)
            assert graph.topic("/value") is None, "the recorder does not keep a topic alive"
    assert [(row[0], row[1]) for row in rows(path)] == [
        ("/value", "std_msgs/msg/Int32"),
        ("/value", "std_msgs/msg/Float64"),
    ]
    with open_recording([path]) as recording:
        assert [topic.type for topic in recording.topics] == ["std_msgs/msg/Float64", "std_msgs/msg/Int32"]
        with Player(MemoryGraph(clock=SimulatedClock(recording.start_ns)), recording) as player:
            assert "recorded with another type, too" in player.publications.skipped["/value"]


def test_without_the_extra_it_is_said_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(errors, "find_spec", lambda name: None)
    for path in (tmp_path / "run.mcap", tmp_path / "run.bag"):
        path.write_bytes(b"")
        with pytest.raises(ExtraMissing, match=r"pip install 'robot-web-tools\[mcap\]'"):
            open_recording([path])
    with pytest.raises(ExtraMissing):
        RecordingWriter(tmp_path / "new.mcap", JAZZY)


def test_nothing_optional_is_loaded_before_it_is_needed() -> None:
    program = (
        "import sys, rwt.cli, rwt.extensions.recording, rwt.extensions.recording.playback\n"
        "optional = {'mcap', 'rosbags', 'zstandard', 'lz4', 'rwt_client', 'numpy'}\n"
        "print(sorted(optional.intersection(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100)
    assert (done.stdout, done.stderr) == ("[]\n", "")
