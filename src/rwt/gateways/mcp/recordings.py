"""Recordings as the tools use them; the composition of the server provides the reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from rwt_participant.messages import Message


@dataclass(frozen=True, slots=True)
class RecordedTopicRow:
    """Topic of a recording.

    Attributes:
        name: absolute name.
        type: type of its messages.
        count: messages; None where the file does not say.
    """

    name: str
    type: str
    count: int | None


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """Summary of one recording.

    Attributes:
        name: name of its file.
        seconds: from its first message to its last.
        start_ns: log time of the first, nanoseconds since the epoch.
        topics: those that the reader may see.
    """

    name: str
    seconds: float
    start_ns: int
    topics: tuple[RecordedTopicRow, ...]


class Recordings(Protocol):
    """A folder of recordings. Everything here blocks, and belongs into a thread."""

    def names(self) -> tuple[str, ...]:
        """The files, sorted."""

    def describe(self, name: str, sees: Callable[[str], bool]) -> RecordingInfo:
        """Return the contents of a recording.

        Args:
            name: one of :meth:`names`.
            sees: returns True if the reader may see a topic.

        Raises:
            ToolError: there is none of that name, or it cannot be read.
        """

    def message(self, name: str, topic: str, seconds: float) -> tuple[Message, str, float]:
        """Return the first message of a topic at or after an offset in seconds.

        Returns:
            The message, its type's name, and when it was recorded, in seconds after the start.

        Raises:
            ToolError: there is none.
        """
