"""Recordings of robots: MCAP files written and read, and bags of ROS 1 and ROS 2 read.

Importing this loads no optional library; they are loaded by what needs them.
"""

from rwt_nodes.recording.channels import ENCODINGS, ChannelForm, Encoding, channel_form
from rwt_nodes.recording.commanded import CommandedRecorder, RecorderFolderError, RecorderLimits
from rwt_nodes.recording.errors import (
    ExtraMissing,
    RecordingError,
    RecordingNotWritten,
    RecordingUnreadable,
)
from rwt_nodes.recording.opening import open_recording
from rwt_nodes.recording.recorder import Recorder, RecordingOptions
from rwt_nodes.recording.recording import RecordedMessage, RecordedTopic, Recording
from rwt_nodes.recording.selection import EVERYTHING, TopicSelection
from rwt_nodes.recording.writer import COMPRESSIONS, Compression, RecordedChannel, RecordingWriter, Split

__all__ = [
    "Recorder",
    "CommandedRecorder",
    "RecorderLimits",
    "RecorderFolderError",
    "RecordingOptions",
    "RecordingWriter",
    "RecordedChannel",
    "ChannelForm",
    "channel_form",
    "TopicSelection",
    "EVERYTHING",
    "Split",
    "Encoding",
    "ENCODINGS",
    "Compression",
    "COMPRESSIONS",
    "Recording",
    "RecordedTopic",
    "RecordedMessage",
    "open_recording",
    "RecordingError",
    "RecordingUnreadable",
    "RecordingNotWritten",
    "ExtraMissing",
]
