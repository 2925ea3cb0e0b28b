"""Errors of recording and playback.

* :exc:`RecordingError`

  * :exc:`ExtraMissing`: the libraries of the extra ``mcap`` are not installed.
  * :exc:`RecordingUnreadable`: not a recording, or not one that can be played.
  * :exc:`RecordingNotWritten`: the disk is full or the file cannot be written; what was written is readable.

    * :exc:`RecordingExists`: the file is there already.
"""

from __future__ import annotations

from importlib.util import find_spec


class RecordingError(Exception):
    """Base of all errors of recordings."""


class ExtraMissing(RecordingError):
    """A library of the extra ``mcap`` is not installed."""


class RecordingUnreadable(RecordingError):
    """The file is not a recording, or holds nothing that can be played."""


class RecordingNotWritten(RecordingError):
    """The file cannot be written; what was written before stays readable.

    Attributes:
        reason: reason without the name of the file, such as "the disk is full"; by default the text.
    """

    def __init__(self, text: str, reason: str = "") -> None:
        super().__init__(text)
        self.reason = reason or text


class RecordingExists(RecordingNotWritten):
    """The file is there already."""


def require(library: str) -> None:
    """Raise :exc:`ExtraMissing` unless `library`, ``mcap`` or ``rosbags``, can be imported."""
    if find_spec(library) is None:
        raise ExtraMissing(
            f"recordings need {library}, which is not installed: pip install 'robot-web-tools[mcap]'"
        )
