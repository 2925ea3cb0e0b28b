"""Conversion of recordings to LeRobot's datasets (version 3), and back.

LeRobot itself reads and writes the datasets, so that their statistics and videos are its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rwt.extensions.recording import Recording, RecordingWriter, channel_form, open_recording
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.times import NANOSECONDS
from rwt_lerobot.datasets.alignment import Span, Spans, frame_times, longest_gap_ns, overlaps
from rwt_lerobot.joints.controller import TOPIC_TYPE
from rwt_lerobot.joints.features import POSITION, FeatureMap
from rwt_participant.images import compressed_image, image_to_numpy

STATE: Final = "observation.state"
ACTION: Final = "action"
IMAGES: Final = "observation.images."
TASK_TOPIC: Final = "/lerobot/task"

_STATE_TYPE: Final = "sensor_msgs/JointState"
_IMAGE_TYPES: Final = ("CompressedImage", "Image")
_READERS: Final[Mapping[str, Callable[[Any, bytes], Payload]]] = {
    "cdr": Payload.from_cdr,
    "ros1": Payload.from_ros1,
    "json": partial(Payload.from_json, is_trusted=True),
}
_MOST_WAITING_BYTES: Final = 16 * 1024 * 1024

Progress: TypeAlias = Callable[[int, int], object]
"""Receives the number of frames that are done, and of all."""


class ConversionError(ValueError):
    """A recording or a dataset cannot be converted; the text gives the reason."""


@dataclass(frozen=True, slots=True)
class Mapped:
    """Names and units of a conversion.

    Attributes:
        states: topic of the joint states.
        commands: topic of the trajectories.
        units: units of joints in the dataset by name; degrees by default.
        ranges: radians at the ends of a joint's range, for the units with a range.
    """

    states: str = "/joint_states"
    commands: str = "/arm_controller/joint_trajectory"
    units: Mapping[str, str] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def features(self, joints: list[str]) -> FeatureMap:
        """Return the features of these joints.

        Raises:
            ConversionError: a unit or a range does not fit.
        """
        ranges = {name: span for name, span in self.ranges.items() if name in joints}
        try:
            return FeatureMap(joints, self.units, ranges)
        except ValueError as error:
            raise ConversionError(str(error)) from error


@dataclass(frozen=True, slots=True)
class Converted:
    """Result of a conversion."""

    episodes: int
    frames: int


@dataclass(frozen=True, slots=True)
class _Frame:
    episode: int
    state: Mapping[str, float]
    action: Mapping[str, float]
    images: Mapping[str, NDArray[np.uint8]]
    task: str


class _Reader:
    """Aligned frames of a recording.

    Attributes:
        joints: joints of the first joint states.
        shapes: shapes of the images by camera.
        episodes: spans in which all topics have messages.
    """

    def __init__(self, recording: Recording, mapped: Mapped, fps: int) -> None:
        self._recording = recording
        self._mapped = mapped
        self._fps = fps
        self._gap_ns = longest_gap_ns(fps)
        self._registry = Registry(recording.distro)
        self._forms = {topic.name: topic for topic in recording.topics}
        self._cameras = self._find_cameras()
        self.joints: list[str] = []
        self.shapes: dict[str, tuple[int, ...]] = {}
        self.episodes = self._find_episodes()

    def _find_cameras(self) -> dict[str, str]:
        """Return names of cameras by topic; of an image that was recorded twice, the compressed one."""
        found: dict[str, str] = {}
        for topic in sorted(self._forms, key=lambda name: not name.endswith("/compressed")):
            if self._forms[topic].type.rpartition("/")[2] in _IMAGE_TYPES:
                name = topic.removesuffix("/compressed").removesuffix("/image_raw").strip("/")
                if (name := name.replace("/", "_")) not in found.values():
                    found[topic] = name
        return found

    def _find_episodes(self) -> list[Span]:
        spans = {topic: Spans(self._gap_ns) for topic in (self._mapped.states, *self._cameras)}
        for message in self._recording.messages(spans.keys()):
            if not spans[message.topic].found:
                self._begin(message)
            spans[message.topic].add(message.log_time)
        episodes: list[Span] | None = None
        for topic, spanned in spans.items():
            if not spanned.found:
                raise ConversionError(f"the recording has no messages on {topic}")
            episodes = spanned.found if episodes is None else overlaps(episodes, spanned.found)
        if not episodes:
            raise ConversionError(f"at no time were there messages on all of {', '.join(spans)}")
        return episodes

    def _begin(self, message: Any) -> None:
        value = self._value(message)
        if message.topic == self._mapped.states:
            self.joints = list(value.name)
        else:
            self.shapes[self._cameras[message.topic]] = _rgb(value).shape

    def _value(self, message: Any) -> Any:
        form = self._forms[message.topic]
        reader = _READERS.get(form.encoding)
        if reader is None:
            raise ConversionError(f"{message.topic}: the encoding of its messages is not supported")
        return reader(self._registry.message(message.type), message.data).value()

    def frames(self, task: str) -> Iterator[_Frame]:
        """Yield the frames. Each has the newest message of each topic, by the time of recording."""
        newest: dict[str, Any] = {}
        wanted: dict[str, tuple[int, float]] = {}
        images: dict[str, tuple[int, NDArray[np.uint8]]] = {}
        before: dict[str, float] = {}

        def frame(episode: int, at: int) -> _Frame:
            nonlocal before
            value = self._value(newest[self._mapped.states])
            given = dict(zip(value.name, value.position, strict=False))
            missing = [name for name in self.joints if name not in given]
            if missing:
                raise ConversionError(f"{self._mapped.states}: a message has no joint {missing[0]!r}")
            begin = self.episodes[episode][0]
            if at == begin:
                before = given
            action = {
                name: wanted[name][1]
                if name in wanted and wanted[name][0] >= begin - self._gap_ns
                else before[name]
                for name in self.joints
            }
            for topic, name in self._cameras.items():
                message = newest[topic]
                if name not in images or images[name][0] != message.log_time:
                    images[name] = message.log_time, _rgb(self._value(message))
            stated = self._value(newest[TASK_TOPIC]).data if TASK_TOPIC in newest else task
            shown = {name: image for name, (_, image) in images.items()}
            return _Frame(episode, given, action, shown, stated)

        ticks = (
            (episode, at) for episode, span in enumerate(self.episodes) for at in frame_times(span, self._fps)
        )
        tick = next(ticks, None)
        topics = [self._mapped.states, self._mapped.commands, TASK_TOPIC, *self._cameras]
        for message in self._recording.messages(topics):
            while tick is not None and message.log_time > tick[1]:
                yield frame(*tick)
                tick = next(ticks, None)
            if message.topic != self._mapped.commands:
                newest[message.topic] = message
                continue
            value = self._value(message)
            if value.points:
                for name, angle in zip(value.joint_names, value.points[-1].positions, strict=False):
                    wanted[name] = message.log_time, angle
        while tick is not None:
            yield frame(*tick)
            tick = next(ticks, None)


def to_dataset(
    path: Path,
    folder: Path,
    mapped: Mapped,
    *,
    fps: int,
    task: str,
    videos: bool = True,
    on_frame: Progress | None = None,
) -> Converted:
    """Convert a recording to a dataset.

    Args:
        path: recording: an MCAP file, a bag of ROS 1, or a folder of rosbag2.
        folder: folder of the dataset, which must not exist.
        mapped: names and units.
        fps: frames per second.
        task: task of all frames for which the recording states none.
        videos: False to store images as PNG.
        on_frame: called after each frame, with the number of frames that are done and of all.

    Raises:
        ConversionError: the recording lacks a topic or a joint, or the folder exists.
        RecordingError: the recording cannot be read.
    """
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    if folder.exists():
        raise ConversionError(f"{folder} is there already")
    with open_recording([path]) as recording:
        reader = _Reader(recording, mapped, fps)
        features = mapped.features(reader.joints)
        names = list(features.features)
        positions = {"dtype": "float32", "shape": (len(names),), "names": names}
        image = {"dtype": "video" if videos else "image", "names": ["height", "width", "channels"]}
        cameras = {f"{IMAGES}{name}": {**image, "shape": shape} for name, shape in reader.shapes.items()}
        dataset = LeRobotDataset.create(
            f"local/{folder.name}", fps, {STATE: positions, ACTION: dict(positions), **cameras},
            root=folder, robot_type="rosbridge", use_videos=videos,
        )  # fmt: skip
        count, episode = 0, 0
        total = sum(1 for span in reader.episodes for _ in frame_times(span, fps))
        for frame in reader.frames(task):
            if frame.episode != episode:
                dataset.save_episode()
                episode = frame.episode
            dataset.add_frame(
                {
                    STATE: _row(features, frame.state),
                    ACTION: _row(features, frame.action),
                    **{f"{IMAGES}{name}": image for name, image in frame.images.items()},
                    "task": frame.task,
                }
            )
            count += 1
            if on_frame is not None:
                on_frame(count, total)
        dataset.save_episode()
        dataset.finalize()
    return Converted(episode + 1, count)


def to_recording(folder: Path, path: Path, mapped: Mapped, *, on_frame: Progress | None = None) -> Converted:
    """Convert a dataset to an MCAP file. Its time begins at 1 s, and a gap follows each episode.

    Args:
        on_frame: called after each frame, with the number of frames that are done and of all.

    Raises:
        ConversionError: it is not a dataset of an arm.
        RecordingError: the file exists, or cannot be written.
    """
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    if not (folder / "meta" / "info.json").is_file():
        raise ConversionError(f"{folder} is not a dataset of LeRobot: it has no meta/info.json")
    dataset = LeRobotDataset(f"local/{folder.name}", root=folder, video_backend="pyav")
    names = _position_names(dataset.features)
    joints = [name.removesuffix(POSITION) for name in names]
    features = mapped.features(joints)
    cameras = [name for name in dataset.features if name.startswith(IMAGES)]
    registry = Registry(JAZZY)
    with RecordingWriter(path, JAZZY) as writer:
        channels: dict[str, Any] = {}

        def write(topic: str, type: str, at: int, value: Mapping[str, Any]) -> None:
            message = registry.message(type)
            if topic not in channels:
                channels[topic] = writer.add_channel(channel_form(topic, message, "ros"))
            while writer.waiting_bytes > _MOST_WAITING_BYTES and writer.failure is None:
                time.sleep(0.01)
            writer.write(channels[topic], at, at, Payload.from_value(message, value).cdr())

        begin, at, episode, index = NANOSECONDS, 0, -1, 0
        for number in range(len(dataset)):
            item = dataset[number]
            if int(item["episode_index"]) != episode:
                episode = int(item["episode_index"])
                begin = at + 2 * longest_gap_ns(dataset.fps) if number else begin
                index = 0
                write(TASK_TOPIC, "std_msgs/String", begin, {"data": item["task"]})
            at = begin + index * NANOSECONDS // dataset.fps
            index += 1
            header = {"stamp": {"sec": at // NANOSECONDS, "nanosec": at % NANOSECONDS}}
            state, action = (
                list(features.radians(dict(zip(names, np.asarray(item[key]).tolist(), strict=True))).values())
                for key in (STATE, ACTION)
            )
            write(mapped.states, _STATE_TYPE, at, {"header": header, "name": joints, "position": state})
            command = {"header": header, "joint_names": joints, "points": [{"positions": action}]}
            write(mapped.commands, TOPIC_TYPE, at, command)
            for camera in cameras:
                name = camera.removeprefix(IMAGES)
                pixels = np.rint(np.asarray(item[camera]).transpose(1, 2, 0) * 255).astype(np.uint8)
                image = compressed_image(pixels, frame_id=f"{name}_optical_frame", stamp_ns=at, quality=95)
                write(f"/{name}/image_raw/compressed", "sensor_msgs/CompressedImage", at, image)
            if on_frame is not None:
                on_frame(number + 1, len(dataset))
    if writer.failure is not None:
        raise writer.failure
    return Converted(dataset.num_episodes, len(dataset))


def _position_names(features: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the names of the joints' positions. Raises ConversionError if the dataset is not of an arm."""
    names = list(features.get(STATE, {}).get("names") or ())
    others = [name for name in names if not name.endswith(POSITION)]
    if not names or others or list(features.get(ACTION, {}).get("names") or ()) != names:
        raise ConversionError(
            f"{STATE} and {ACTION} must be the same joints, with names such as elbow_flex.pos; got {names}"
        )
    return names


def _row(features: FeatureMap, radians: Mapping[str, float]) -> NDArray[np.float32]:
    values = features.read(list(radians), list(radians.values()))
    return np.array(list(values.values()), np.float32)


def _rgb(message: Any) -> NDArray[np.uint8]:
    pixels: NDArray[np.uint8] = image_to_numpy(message)
    if getattr(message, "encoding", "") == "bgr8":
        pixels = pixels[:, :, ::-1]
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
        raise ConversionError(f"images of {pixels.dtype}, {pixels.shape} are not supported: expected colours")
    return np.ascontiguousarray(pixels)
