"""Recordings: topics and messages, independent of the file format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from typing import Final, Literal, Self

from msgspec import Struct

from rwt.extensions.recording.errors import RecordingUnreadable
from rwt_interfaces.distro import Distro
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import QoS

CHUNK_BYTES: Final = 128 * 1024 * 1024
"""Default maximum size of an unpacked MCAP chunk. Writers use some megabytes, or one large message."""

MessageEncoding = Literal["cdr", "ros1", "json", ""]
"""Encoding of a topic's messages; empty if not readable."""


@dataclass(frozen=True, slots=True)
class RecordedTopic:
    """Topic of a recording.

    Attributes:
        name: absolute name.
        type: the type's name as it was recorded.
        definition: the type's definition with those it contains (API-06); empty where it was not recorded.
        count: messages; None where the file does not say.
        offered_qos: QoS of its publishers, if known.
    """

    name: str
    type: str
    encoding: MessageEncoding
    definition: str = ""
    count: int | None = None
    offered_qos: tuple[QoS, ...] = ()


class RecordedMessage(Struct, frozen=True, gc=False):
    """Message of a recording.

    Attributes:
        type: the type's name as it was recorded.
        log_time: time of recording, nanoseconds since the epoch.
        publish_time: time of publishing, nanoseconds since the epoch.
    """

    topic: str
    type: str
    log_time: int
    publish_time: int
    data: bytes


class Recording(ABC):
    """Open recording. Several threads may read it at once, each with its own iterator.

    Attributes:
        paths: files of the recording.
        topics: sorted by name; a topic of two types is there twice.
        start_ns, end_ns: log times of the first and the last message; both 0 when there is none.
        complete: True if the file was ended properly. One that was not is read as far as it goes.
    """

    paths: tuple[Path, ...]
    distro: Distro
    topics: tuple[RecordedTopic, ...]
    start_ns: int
    end_ns: int
    complete: bool = True

    @property
    def damaged(self) -> int:
        """Places that could not be read and were left out, as far as the recording was read."""
        return 0

    @property
    def seconds(self) -> float:
        """Time from the first message to the last, in seconds."""
        return (self.end_ns - self.start_ns) / NANOSECONDS

    @property
    def message_count(self) -> int:
        """Messages of all topics whose number the file says."""
        return sum(topic.count or 0 for topic in self.topics)

    @abstractmethod
    def messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of `topics` (None: all) from `start_ns` to before `end_ns`, by log time, then
        file order.

        Raises:
            RecordingUnreadable: what comes next is damaged.
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


class MergedRecording(Recording):
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

    @property
    def damaged(self) -> int:
        """Sum of the places of all."""
        return sum(part.damaged for part in self._parts)

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of all; see :meth:`Recording.messages`."""
        parts = (part.messages(topics, start_ns, end_ns) for part in self._parts)
        return merge(*parts, key=lambda message: message.log_time)

    def close(self) -> None:
        """Close all."""
        for part in self._parts:
            part.close()
