"""Recordings of robots: MCAP files (read and write), and bags of ROS 1 and ROS 2 (read).

Optional libraries are loaded on first use.
"""

from rwt.nodes.recording.channels import ENCODINGS, ChannelForm, Encoding, channel_form
from rwt.nodes.recording.errors import (
    ExtraMissing,
    RecordingError,
    RecordingExists,
    RecordingNotWritten,
    RecordingUnreadable,
)
from rwt.nodes.recording.opening import open_recording
from rwt.nodes.recording.recorder import Recorder, record_graph
from rwt.nodes.recording.recorder_node import RecorderFolderError, RecorderLimits, RecorderNode
from rwt.nodes.recording.recording import (
    EVERYTHING,
    RecordedMessage,
    RecordedTopic,
    Recording,
    TopicSelection,
)
from rwt.nodes.recording.writer import (
    COMPRESSIONS,
    Compression,
    RecordedChannel,
    RecordingOptions,
    RecordingWriter,
    Split,
)

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
