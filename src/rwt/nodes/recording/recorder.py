"""A node that records the messages of every topic of its graph in an MCAP file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rwt.nodes.recording.channels import Encoding, channel_form
from rwt.nodes.recording.selection import EVERYTHING, TopicSelection
from rwt.nodes.recording.writer import Compression, RecordingWriter, Split
from rwt_participant.qos import BEST_AVAILABLE

if TYPE_CHECKING:
    from rwt.nodes.recording.writer import RecordedChannel
    from rwt_graph.api import Graph, Sample, Subscription
    from rwt_interfaces.payload import Payload
    from rwt_participant.timers import Timer

LOOK_SECONDS: Final = 0.2
"""How often the graph is asked for topics that were not there before."""

_MESSAGE_BYTES: Final = 31
"""What MCAP writes of a message besides its content (its specification, the record Message)."""


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """How a recording is made.

    Attributes:
        encoding: ``ros`` (CDR, or ROS 1's own form on ROS 1) or ``json``.
        compression: of the chunks.
        split: when a new file is begun.
        overwrite: whether a file that is there may be replaced.
        largest_bytes: content after which nothing more is taken, definitions included and before compression;
            0: as much as there is.
    """

    encoding: Encoding = "ros"
    compression: Compression = "zstd"
    split: Split | None = field(default=None)
    overwrite: bool = False
    largest_bytes: int = 0


class Recorder:
    """Writes the topics of a graph to a file until it is closed.

    A message's publish time is the graph's time of publishing. Its log time is the same, but not before the
    recording began: what was kept for late joiners is logged as the first thing there is.

    Args:
        graph: any backend; recording begins at once, also before the graph runs.
        path: the file.
        selection: which topics; everything by default.
        name: the node's absolute name.

    Attributes:
        writer: what was written so far.
        is_full: whether `largest_bytes` was reached; then it has stopped.

    Raises:
        RecordingNotWritten: the file cannot be made.
        ExtraMissing: the extra ``mcap`` is not installed.
    """

    def __init__(
        self,
        graph: Graph,
        path: Path,
        selection: TopicSelection = EVERYTHING,
        options: RecordingOptions = RecordingOptions(),
        *,
        name: str = "/recorder",
    ) -> None:
        self._graph = graph
        self._selection = selection
        self._encoding = options.encoding
        self._room = options.largest_bytes or None
        self.is_full = False
        self.writer = RecordingWriter(
            path,
            graph.distro,
            options.encoding,
            compression=options.compression,
            split=options.split,
            overwrite=options.overwrite,
        )
        self._name = name
        self._participant = graph.participant(name)
        self._began_at = graph.clock.time_ns()
        self._topics: dict[str, _RecordedTopic] = {}
        self._timer: Timer | None = None
        self._tick()

    def _tick(self) -> None:
        self.look()
        self._timer = self._graph.clock.call_later(LOOK_SECONDS, self._tick)

    def look(self) -> None:
        """Record the topics that are new; done by itself every 0.2 s. To be called on the graph's thread."""
        for topic in self._graph.topics():
            if not self._selection.takes(topic.name):
                continue
            recorded = self._topics.get(topic.name) or _RecordedTopic(self)
            self._topics[topic.name] = recorded
            alone = not topic.publishers and all(each.node == self._name for each in topic.subscribers)
            if recorded.subscription is None:
                # Without a type: the recorder holds none for a topic that others use.
                recorded.subscription = self._participant.subscribe(
                    topic.name, recorded.receive, None, BEST_AVAILABLE
                )
            elif alone:
                # A topic exists while others use it; the recorder's subscription must not keep it alive.
                recorded.subscription.close()
                recorded.subscription = None

    def record(self, channel: RecordedChannel, sample: Sample) -> None:
        """Write one sample."""
        stamp, data = sample.stamp_ns, self._written(sample.payload)
        if self._takes(len(data) + _MESSAGE_BYTES):
            self.writer.write(channel, max(stamp, self._began_at), stamp, data)

    def _takes(self, size: int) -> bool:
        """Whether so many bytes more are taken. The first that are too many end the recording."""
        if self._room is None:
            return True
        if self.is_full or size > self._room:
            if not self.is_full:
                self.is_full = True
                # Not from within a delivery to one of the subscriptions that this closes.
                self._graph.clock.call_later(0.0, self.stop)
            return False
        self._room -= size
        return True

    def _written(self, payload: Payload) -> bytes | memoryview:
        if self._encoding == "json":
            return bytes(payload.json())  # Perhaps a view of a receive buffer.
        return payload.serialised()

    def channel_of(self, sample: Sample) -> RecordedChannel:
        """A channel for the topic and type of a sample."""
        info = self._graph.topic(sample.topic)
        offered_qos = () if info is None else tuple(publisher.qos for publisher in info.publishers)
        form = channel_form(sample.topic, sample.payload.type, self._encoding, offered_qos)
        self._takes(len(form.schema) + sum(len(value) for value in form.metadata.values()))
        return self.writer.add_channel(form)

    def stop(self) -> None:
        """Record nothing more; what was taken is still written. To be called on the graph's thread."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._participant.close()

    def close(self) -> None:
        """Stop, end the file and wait for that. May be called twice.

        Raises:
            RecordingNotWritten: not everything could be written.
        """
        self.stop()
        self.writer.close()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class _RecordedTopic:
    """One topic: a channel for each type that it has had."""

    __slots__ = ("_channels", "_recorder", "subscription")

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._channels: dict[str, RecordedChannel] = {}
        self.subscription: Subscription | None = None

    def receive(self, sample: Sample) -> None:
        """Record one sample."""
        channel = self._channels.get(sample.payload.type.name)
        if channel is None:
            channel = self._channels[sample.payload.type.name] = self._recorder.channel_of(sample)
        self._recorder.record(channel, sample)
