"""Recordings and LeRobot's datasets, converted in both directions, by LeRobot or its fake."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from rwt.extensions.recording import RecordingWriter, channel_form
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_lerobot.datasets.alignment import Spans, frame_times, longest_gap_ns, overlaps
from rwt_lerobot.datasets.convert import ConversionError, Mapped, to_dataset, to_recording
from rwt_participant.images import compressed_image

SECOND = 10**9
MAPPED = Mapped(units={"gripper": "range_0_100"}, ranges={"gripper": (0.0, 1.0)})

Write = Callable[[str, str, float, dict[str, Any]], None]


def _record(path: Path, fill: Callable[[Write], None]) -> Path:
    registry, channels = Registry(JAZZY), dict[str, Any]()
    with RecordingWriter(path, JAZZY) as writer:

        def write(topic: str, type: str, seconds: float, value: dict[str, Any]) -> None:
            message = registry.message(type)
            if topic not in channels:
                channels[topic] = writer.add_channel(channel_form(topic, message, "ros"))
            at = round(seconds * SECOND)
            writer.write(channels[topic], at, at, Payload.from_value(message, value).cdr())

        fill(write)
    return path


def _state(write: Write, at: float, pan: float) -> None:
    value = {"name": ["pan", "gripper"], "position": [pan, 0.5]}
    write("/joint_states", "sensor_msgs/JointState", at, value)


def _command(write: Write, at: float, pan: float) -> None:
    value = {"joint_names": ["pan"], "points": [{"positions": [pan]}]}
    write("/arm_controller/joint_trajectory", "trajectory_msgs/JointTrajectory", at, value)


def _image(write: Write, at: float, brightness: int) -> None:
    image = compressed_image(np.full((64, 96, 3), brightness, np.uint8))
    write("/front/image_raw/compressed", "sensor_msgs/CompressedImage", at, image)


def _run(write: Write) -> None:
    """Write two episodes, 10.0 to 11.0 and 15.0 to 15.5 s; images begin late, and are rarer than states."""
    for number in range(23):
        _state(write, 9.9 + number * 0.05, number * 0.01)
    for number in range(11):
        _image(write, 10.0 + number * 0.1, number * 20)
    _command(write, 10.42, 0.8)
    for number in range(11):
        _state(write, 15.0 + number * 0.05, 1.0)
        _image(write, 15.0 + number * 0.05, 200)


def _rows(folder: Path, key: str) -> Any:
    dataset = LeRobotDataset("local/test", root=folder, video_backend="pyav")
    return np.array([np.asarray(dataset[index][key]) for index in range(len(dataset))])


def test_each_frame_has_the_newest_messages(tmp_path: Path) -> None:
    path = _record(tmp_path / "run.mcap", _run)
    done = to_dataset(path, tmp_path / "data", MAPPED, fps=10, task="push", videos=False)
    assert (done.episodes, done.frames) == (2, 11 + 6)
    states, actions = _rows(tmp_path / "data", "observation.state"), _rows(tmp_path / "data", "action")
    assert states[:11, 0] == pytest.approx(
        [math.degrees(0.02 + 0.02 * index) for index in range(11)], abs=1e-4
    )
    assert states[:, 1] == pytest.approx(50.0)
    # Until a command the action is the position at the start; commands of another episode do not count.
    assert actions[:, 0] == pytest.approx(
        [*[math.degrees(0.02)] * 5, *[math.degrees(0.8)] * 6, *[math.degrees(1.0)] * 6], abs=1e-4
    )
    brightness = _rows(tmp_path / "data", "observation.images.front")[:, 0, 0, 0] * 255
    assert brightness == pytest.approx([*range(0, 201, 20), *[200] * 6], abs=2)


def test_a_round_trip_keeps_the_frames(tmp_path: Path) -> None:
    path = _record(tmp_path / "run.mcap", _run)
    to_dataset(path, tmp_path / "one", MAPPED, fps=30, task="push", videos=False)
    back = to_recording(tmp_path / "one", tmp_path / "back.mcap", MAPPED)
    again = to_dataset(tmp_path / "back.mcap", tmp_path / "two", MAPPED, fps=30, task="other", videos=False)
    assert back == again
    for key, error in (("observation.state", 1e-4), ("action", 1e-4), ("observation.images.front", 0.02)):
        one, two = _rows(tmp_path / "one", key), _rows(tmp_path / "two", key)
        assert one.shape == two.shape
        assert np.abs(one - two).max() < error
    for key in ("episode_index",):
        assert (_rows(tmp_path / "one", key) == _rows(tmp_path / "two", key)).all()
    assert LeRobotDataset("local/test", root=tmp_path / "two", video_backend="pyav")[0]["task"] == "push"


def test_a_gap_in_one_topic_ends_the_episode() -> None:
    states, images = Spans(longest_gap_ns(30)), Spans(longest_gap_ns(30))
    for number in range(31):
        states.add(number * SECOND // 10)
        if not 10 < number < 20:
            images.add(number * SECOND // 10)
    assert overlaps(states.found, images.found) == [(0, SECOND), (2 * SECOND, 3 * SECOND)]
    assert [*frame_times((5, 5 + SECOND // 10), 30)] == [5, 33_333_338, 66_666_671, 100_000_005]


def test_what_cannot_be_converted(tmp_path: Path) -> None:
    path = _record(tmp_path / "images.mcap", lambda write: _image(write, 1.0, 1))
    with pytest.raises(ConversionError, match="no messages on /joint_states"):
        to_dataset(path, tmp_path / "data", MAPPED, fps=30, task="push")
    with pytest.raises(ConversionError, match=r"has no meta/info\.json"):
        to_recording(tmp_path, tmp_path / "back.mcap", MAPPED)
    (tmp_path / "data").mkdir()
    with pytest.raises(ConversionError, match="is there already"):
        to_dataset(path, tmp_path / "data", MAPPED, fps=30, task="push")
