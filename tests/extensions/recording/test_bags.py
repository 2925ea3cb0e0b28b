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
from rwt_interfaces import NOETIC, Registry

START = 1_700_000_000_000_000_000
OWN_TYPE = "std_msgs/Header header\nfloat32[] levels\nuint8 OK=1\n"
NEVER = QosTime(0, 0)
LATCHED = Qos(
    QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, NEVER, NEVER,
    QosLiveliness.AUTOMATIC, NEVER, False,
)  # fmt: skip


def ros1_bag(path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(OWN_TYPE, "my_robot/msg/Levels"))
    with Writer1(path) as bag:
        mode = bag.add_connection("/mode", "std_msgs/msg/String", typestore=store, latching=1)
        levels = bag.add_connection("/levels", "my_robot/msg/Levels", typestore=store)
        text = store.types["std_msgs/msg/String"](data="slow")
        bag.write(mode, START, store.serialize_ros1(text, "std_msgs/msg/String"))
        for index in range(3):
            message = store.types["my_robot/msg/Levels"](header=_header(store, 1), levels=_floats(index))
            data = store.serialize_ros1(message, "my_robot/msg/Levels")
            bag.write(levels, START + index * 10**9, data)


def ros2_bag(path: Path, plugin: StoragePlugin) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(OWN_TYPE, "my_robot/msg/Levels"))
    with Writer2(path, version=9, storage_plugin=plugin) as bag:
        mode = bag.add_connection(
            "/mode", "std_msgs/msg/String", typestore=store, offered_qos_profiles=[LATCHED]
        )
        levels = bag.add_connection("/levels", "my_robot/msg/Levels", typestore=store)
        text = store.types["std_msgs/msg/String"](data="slow")
        bag.write(mode, START, store.serialize_cdr(text, "std_msgs/msg/String"))
        for index in range(3):
            message = store.types["my_robot/msg/Levels"](header=_header(store, 2), levels=_floats(index))
            data = store.serialize_cdr(message, "my_robot/msg/Levels")
            bag.write(levels, START + index * 10**9, data)


def _header(store: Any, version: int) -> Any:
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    sequence = {"seq": 7} if version == 1 else {}
    return types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="tank")


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


def test_a_bag_of_ros_1_plays(tmp_path: Path) -> None:
    path = tmp_path / "run.bag"
    ros1_bag(path)
    with open_recording([path]) as recording:
        assert recording.distro is NOETIC
        assert [(topic.name, topic.count) for topic in recording.topics] == [("/levels", 3), ("/mode", 1)]
        assert (recording.start_ns, recording.end_ns) == (START, START + 2 * 10**9)
        clock = SimulatedClock(recording.start_ns)
        plays(recording, MemoryGraph(Registry(NOETIC), clock), clock)


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_bag_of_ros_2_plays(tmp_path: Path, plugin: StoragePlugin) -> None:
    path = tmp_path / "run"
    ros2_bag(path, plugin)
    with open_recording([path]) as recording:
        assert recording.end_ns == START + 2 * 10**9
        clock = SimulatedClock(recording.start_ns)
        plays(recording, MemoryGraph(clock=clock), clock)


def test_recordings_of_different_ros_are_not_played_together(tmp_path: Path) -> None:
    ros1_bag(tmp_path / "run.bag")
    ros2_bag(tmp_path / "run", StoragePlugin.SQLITE3)
    with pytest.raises(Exception, match="ROS 1 and of ROS 2 cannot be played together"):
        open_recording([tmp_path / "run.bag", tmp_path / "run"])


def test_recordings_play_together_in_order(tmp_path: Path) -> None:
    ros2_bag(tmp_path / "one", StoragePlugin.SQLITE3)
    ros2_bag(tmp_path / "two", StoragePlugin.MCAP)
    with open_recording([tmp_path / "one", tmp_path / "two"]) as recording:
        assert [(topic.name, topic.count) for topic in recording.topics] == [("/levels", 6), ("/mode", 2)]
        times = [message.log_time for message in recording.messages()]
        assert times == sorted(times)
        assert len(times) == 8
