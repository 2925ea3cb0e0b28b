"""What can be played: a recording's topics and messages, whatever file they are in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from typing import Literal, Self

from msgspec import Struct

from rwt_interfaces.distro import Distro
from rwt_nodes.recording.errors import RecordingUnreadable, require
from rwt_program.qos import QoS

MessageEncoding = Literal["cdr", "ros1", "json", ""]
"""How a topic's messages are written; empty for an encoding that cannot be read."""


@dataclass(frozen=True, slots=True)
class RecordedTopic:
    """One topic of a recording.

    Attributes:
        name: absolute name.
        type: the type's name as it was recorded.
        encoding: how its messages are written.
        definition: the type's definition with those it contains (API-06); empty where it was not recorded.
        count: messages; None where the file does not say.
        offered_qos: what its publishers offered_qos, where that is known.
    """

    name: str
    type: str
    encoding: MessageEncoding
    definition: str = ""
    count: int | None = None
    offered_qos: tuple[QoS, ...] = ()


class RecordedMessage(Struct, frozen=True, gc=False):
    """One message of a recording.

    Attributes:
        topic: of its topic.
        type: the type's name as it was recorded.
        log_time: when it was recorded, nanoseconds since the epoch.
        publish_time: when it was published, likewise.
        data: as the topic's encoding has it.
    """

    topic: str
    type: str
    log_time: int
    publish_time: int
    data: bytes


class Recording(ABC):
    """An open recording. Any number of readings may be under way at once, each in one thread.

    Attributes:
        paths: its files.
        distro: of its messages.
        topics: sorted by name; a topic of two types is there twice.
        start_ns, end_ns: log times of the first and the last message; both 0 when there is none.
        complete: whether the file was ended properly. One that was not is read as far as it goes.
    """

    paths: tuple[Path, ...]
    distro: Distro
    topics: tuple[RecordedTopic, ...]
    start_ns: int
    end_ns: int
    complete: bool = True

    @abstractmethod
    def messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """The messages of `topics` (None: of all) from `start_ns` to before `end_ns`, by log time.

        Those of one log time come in the order of the file.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the files."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def merged_topics(topics: list[RecordedTopic]) -> tuple[RecordedTopic, ...]:
    """Topics sorted by name, those of the same name and type as one with their messages added up."""
    found: dict[tuple[str, str], RecordedTopic] = {}
    for topic in topics:
        known = found.get((topic.name, topic.type))
        if known is None:
            found[topic.name, topic.type] = topic
            continue
        count = None if known.count is None or topic.count is None else known.count + topic.count
        offered_qos = known.offered_qos + tuple(
            qos for qos in topic.offered_qos if qos not in known.offered_qos
        )
        found[topic.name, topic.type] = RecordedTopic(
            known.name, known.type, known.encoding, known.definition, count, offered_qos
        )
    return tuple(sorted(found.values(), key=lambda topic: (topic.name, topic.type)))


def open_recording(paths: Sequence[Path]) -> Recording:
    """Open a recording: MCAP files, ROS 1 bags, or folders of rosbag2; several are played together.

    Raises:
        RecordingUnreadable: one is not a recording, or they speak different versions of ROS.
        ExtraMissing: the extra ``mcap`` is not installed.
    """
    opened: list[Recording] = []
    try:
        opened.extend(_open(path) for path in paths)
        if not opened:
            raise RecordingUnreadable("no recording was named")
        return opened[0] if len(opened) == 1 else _Together(opened)
    except BaseException:
        for recording in opened:
            recording.close()
        raise


def _open(path: Path) -> Recording:
    if not path.exists():
        raise RecordingUnreadable(f"{path}: there is no such file")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise RecordingUnreadable(f"{path} is no recording: a folder of rosbag2 has a file metadata.yaml")
    if path.is_dir() or path.suffix == ".bag":
        require("rosbags")
        from rwt_nodes.recording.bags import BagRecording

        return BagRecording(path)
    if path.suffix == ".db3":
        raise RecordingUnreadable(f"{path} is a part of a rosbag2 recording: name its folder instead")
    require("mcap")
    from rwt_nodes.recording.mcap_files import McapRecording

    return McapRecording(path)


class _Together(Recording):
    """Several recordings as one."""

    def __init__(self, parts: list[Recording]) -> None:
        if len({part.distro.serialisation for part in parts}) > 1:
            raise RecordingUnreadable("recordings of ROS 1 and of ROS 2 cannot be played together")
        self._parts = parts
        self.distro = parts[0].distro
        self.paths = tuple(path for part in parts for path in part.paths)
        self.complete = all(part.complete for part in parts)
        filled = [part for part in parts if part.end_ns]
        self.start_ns = min((part.start_ns for part in filled), default=0)
        self.end_ns = max((part.end_ns for part in filled), default=0)
        self.topics = merged_topics([topic for part in parts for topic in part.topics])

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """The messages of all parts."""
        parts = (part.messages(topics, start_ns, end_ns) for part in self._parts)
        return merge(*parts, key=lambda message: message.log_time)

    def close(self) -> None:
        """Close every part."""
        for part in self._parts:
            part.close()
