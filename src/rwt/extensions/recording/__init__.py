"""Recordings of robots: MCAP files (read and write), and bags of ROS 1 and ROS 2 (read).

Optional libraries are loaded on first use.
"""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.recording.channels import ENCODINGS as ENCODINGS
    from rwt.extensions.recording.channels import ChannelForm as ChannelForm
    from rwt.extensions.recording.channels import Encoding as Encoding
    from rwt.extensions.recording.channels import channel_form as channel_form
    from rwt.extensions.recording.errors import ExtraMissing as ExtraMissing
    from rwt.extensions.recording.errors import RecordingError as RecordingError
    from rwt.extensions.recording.errors import RecordingExists as RecordingExists
    from rwt.extensions.recording.errors import RecordingNotWritten as RecordingNotWritten
    from rwt.extensions.recording.errors import RecordingUnreadable as RecordingUnreadable
    from rwt.extensions.recording.opening import open_recording as open_recording
    from rwt.extensions.recording.recorder import Recorder as Recorder
    from rwt.extensions.recording.recorder import record_graph as record_graph
    from rwt.extensions.recording.recorder_node import RecorderFolderError as RecorderFolderError
    from rwt.extensions.recording.recorder_node import RecorderLimits as RecorderLimits
    from rwt.extensions.recording.recorder_node import RecorderNode as RecorderNode
    from rwt.extensions.recording.recording import RecordedMessage as RecordedMessage
    from rwt.extensions.recording.recording import RecordedTopic as RecordedTopic
    from rwt.extensions.recording.recording import Recording as Recording
    from rwt.extensions.recording.writer import COMPRESSIONS as COMPRESSIONS
    from rwt.extensions.recording.writer import Compression as Compression
    from rwt.extensions.recording.writer import RecordedChannel as RecordedChannel
    from rwt.extensions.recording.writer import RecordingOptions as RecordingOptions
    from rwt.extensions.recording.writer import RecordingWriter as RecordingWriter
    from rwt.extensions.recording.writer import Split as Split
    from rwt_graph.topic_selection import EVERYTHING as EVERYTHING
    from rwt_graph.topic_selection import TopicSelection as TopicSelection

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.recording.channels": ("ENCODINGS ChannelForm Encoding channel_form"),
        "rwt.extensions.recording.errors": (
            "ExtraMissing RecordingError RecordingExists RecordingNotWritten RecordingUnreadable"
        ),
        "rwt.extensions.recording.opening": ("open_recording"),
        "rwt.extensions.recording.recorder": ("Recorder record_graph"),
        "rwt.extensions.recording.recorder_node": ("RecorderFolderError RecorderLimits RecorderNode"),
        "rwt.extensions.recording.recording": ("RecordedMessage RecordedTopic Recording"),
        "rwt.extensions.recording.writer": (
            "COMPRESSIONS Compression RecordedChannel RecordingOptions RecordingWriter Split"
        ),
        "rwt_graph.topic_selection": ("EVERYTHING TopicSelection"),
    },
)
