"""Recordings of robots: MCAP files (read and write), and bags of ROS 1 and ROS 2 (read).

Optional libraries are loaded on first use.
"""

from rwt.extensions.recording.channels import ENCODINGS, ChannelForm, Encoding, channel_form
from rwt.extensions.recording.errors import (
    ExtraMissing,
    RecordingError,
    RecordingExists,
    RecordingNotWritten,
    RecordingUnreadable,
)
from rwt.extensions.recording.opening import open_recording
from rwt.extensions.recording.recorder import Recorder, record_graph
from rwt.extensions.recording.recorder_node import RecorderFolderError, RecorderLimits, RecorderNode
from rwt.extensions.recording.recording import RecordedMessage, RecordedTopic, Recording
from rwt.extensions.recording.writer import (
    COMPRESSIONS,
    Compression,
    RecordedChannel,
    RecordingOptions,
    RecordingWriter,
    Split,
)
from rwt_graph.topic_selection import EVERYTHING, TopicSelection

__all__ = [
    "Recorder",
    "record_graph",
    "RecorderNode",
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
    "RecordingExists",
    "ExtraMissing",
]
