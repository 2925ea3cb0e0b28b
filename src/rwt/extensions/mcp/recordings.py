"""Folder of recordings that agents may read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rwt.extensions.mcp.errors import ToolError
from rwt.extensions.recording import RecordedMessage, RecordedTopic, Recording, RecordingError, open_recording
from rwt.extensions.recording.playback.publications import add_recorded_types, read_payload
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.messages import Message
from rwt_participant.spelling import did_you_mean

_SUFFIXES = frozenset({".mcap", ".bag", ".db3"})


class RecordingFolder:
    """Recordings directly in one folder: MCAP files, bags of ROS 1, and folders of ROS 2 bags.

    The methods block, and raise ToolError for what does not exist or is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> tuple[str, ...]:
        """Return the names of the recordings, sorted."""
        try:
            # A pipe would never be read to its end, and a name with a line break would be two in a list.
            found = [it.name for it in self._folder.iterdir() if it.name.isprintable() and _is_recording(it)]
            return tuple(sorted(found))
        except OSError as error:
            raise ToolError(f"the recordings cannot be listed: {error.strerror}") from None

    def describe(self, name: str, sees: Callable[[str], bool]) -> list[str]:
        """Return lines about a recording and its visible topics."""
        with self._opened(name) as recording:
            start = recording.start_ns
            lines = [f"{name}: {recording.seconds:.1f} s, from {start} ns since the epoch; topics:"]
            for topic in recording.topics:
                if sees(topic.name):
                    count = "" if topic.count is None else f" ({topic.count} messages)"
                    lines.append(f"{topic.name} [{topic.type}]{count}")
            return lines

    def message(self, name: str, topic: str, seconds: float) -> tuple[Message, str, float]:
        """Return the first message of a topic at or after a time, its type and its time in seconds."""
        with self._opened(name) as recording:
            known = next((each for each in recording.topics if each.name == topic), None)
            if known is None:
                raise ToolError(f"{name} has no topic {topic}")
            start = recording.start_ns + round(seconds * NANOSECONDS)
            try:
                found = next(recording.messages({topic}, start), None)
            except RecordingError as error:
                raise ToolError(str(error)) from None
            if found is None:
                length = f"{recording.seconds:.1f} s"
                raise ToolError(
                    f"{name} has no message of {topic} from {seconds:g} s on; it is {length} long"
                )
            message, type = _decoded(recording, known, found)
            return message, type, (found.log_time - recording.start_ns) / NANOSECONDS

    def _opened(self, name: str) -> Recording:
        names = self.names()
        if name not in names:
            raise ToolError(f"there is no recording {name[:100]!r}{did_you_mean(name, names)}")
        try:
            return open_recording([self._folder / name])
        except RecordingError as error:
            raise ToolError(str(error).replace(f"{self._folder}/", "")) from None


def _is_recording(path: Path) -> bool:
    return (path.suffix in _SUFFIXES and path.is_file()) or (path / "metadata.yaml").is_file()


def _decoded(recording: Recording, topic: RecordedTopic, found: RecordedMessage) -> tuple[Message, str]:
    if not topic.encoding:
        raise ToolError(f"{topic.name} is recorded in an encoding that is not known here")
    registry = Registry(recording.distro)
    try:
        add_recorded_types(registry, recording)
        type = registry.message(topic.type)
        return read_payload(topic.encoding, type, found.data).value(), type.name
    except InterfaceError as error:
        raise ToolError(f"the message of {topic.name} cannot be read: {error}") from None
