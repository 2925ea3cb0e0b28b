"""Bags that rosbags has written play."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rwt.extensions.recording import Recording, open_recording
from rwt.extensions.recording.playback import Player
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_graph.api import Sample
from rwt_interfaces import JAZZY, NOETIC, Registry

START = 1_700_000_000_000_000_000
STRING, LEVELS = "std_msgs/msg/String", "my_robot/msg/Levels"
OWN_TYPE = "std_msgs/Header header\nfloat32[] levels\nuint8 OK=1\n"
NEVER = QosTime(0, 0)
LATCHED = Qos(
    QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, NEVER, NEVER,
    QosLiveliness.AUTOMATIC, NEVER, False,
)  # fmt: skip


def write_bag(path: Path, plugin: StoragePlugin | None = None) -> None:
    """Write a bag of ROS 2, or of ROS 1 without a plugin."""
    is_ros1 = plugin is None
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(OWN_TYPE, LEVELS))
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    latched: Any = {"latching": 1} if is_ros1 else {"offered_qos_profiles": [LATCHED]}
    stamp = store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    sequence = {"seq": 7} if is_ros1 else {}
    header = store.types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="tank")
    bag: Any = Writer1(path) if plugin is None else Writer2(path, version=9, storage_plugin=plugin)
    with bag:
        mode = bag.add_connection("/mode", STRING, typestore=store, **latched)
        levels = bag.add_connection("/levels", LEVELS, typestore=store)
        bag.write(mode, START, serialize(store.types[STRING](data="slow"), STRING))
        for index in range(3):
            message = store.types[LEVELS](header=header, levels=_floats(index))
            bag.write(levels, START + index * 10**9, serialize(message, LEVELS))


def _floats(index: int) -> Any:
    import numpy

    return numpy.array([index, index / 2], dtype=numpy.float32)


def plays(recording: Recording, graph: MemoryGraph, clock: SimulatedClock) -> None:
    heard: list[tuple[int, object, str]] = []
    modes: list[str] = []

    def hear(sample: Sample) -> None:
        levels: Any = sample.payload.value()
        heard.append((sample.stamp_ns, list(levels.levels), levels.header.frame_id))

    with Player(graph, recording), Node(graph, "listener") as node:
        node.subscribe_samples("/levels", on_sample=hear)
        clock.advance(10.0)
        # Late, but it was kept.
        node.subscribe("/mode", lambda message: modes.append(message.data))
    assert heard == [(START + index * 10**9, [index, index / 2], "tank") for index in range(3)]
    assert modes == ["slow"]


@pytest.mark.parametrize("plugin", [None, StoragePlugin.SQLITE3, StoragePlugin.MCAP], ids=str)
def test_a_bag_plays(tmp_path: Path, plugin: StoragePlugin | None) -> None:
    path = tmp_path / ("run.bag" if plugin is None else "run")
    write_bag(path, plugin)
    with open_recording([path]) as recording:
        assert recording.distro is (NOETIC if plugin is None else JAZZY)
        assert [(topic.name, topic.count) for topic in recording.topics] == [("/levels", 3), ("/mode", 1)]
        assert (recording.start_ns, recording.end_ns) == (START, START + 2 * 10**9)
        clock = SimulatedClock(recording.start_ns)
        plays(recording, MemoryGraph(Registry(recording.distro), clock), clock)


def test_recordings_of_different_ros_are_not_played_together(tmp_path: Path) -> None:
    write_bag(tmp_path / "run.bag")
    write_bag(tmp_path / "run", StoragePlugin.SQLITE3)
    with pytest.raises(Exception, match="ROS 1 and of ROS 2 cannot be played together"):
        open_recording([tmp_path / "run.bag", tmp_path / "run"])


def test_recordings_play_together_in_order(tmp_path: Path) -> None:
    write_bag(tmp_path / "one", StoragePlugin.SQLITE3)
    write_bag(tmp_path / "two", StoragePlugin.MCAP)
    with open_recording([tmp_path / "one", tmp_path / "two"]) as recording:
        assert [(topic.name, topic.count) for topic in recording.topics] == [("/levels", 6), ("/mode", 2)]
        times = [message.log_time for message in recording.messages()]
        assert times == sorted(times)
        assert len(times) == 8
