"""Recorder of a robot's topics, as they appear, in an MCAP file: a graph's, or those of a connected robot."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rwt.extensions.recording.channels import KEPT, KEPT_TRANSFORMS, channel_form
from rwt.extensions.recording.writer import (
    DEFAULT_OPTIONS,
    RecordedChannel,
    RecordingOptions,
    RecordingWriter,
)
from rwt_graph.api import Graph
from rwt_graph.nodes.graph_robot import GraphRobot
from rwt_graph.topic_selection import EVERYTHING, TopicSelection
from rwt_interfaces import InvalidMessage, Payload
from rwt_participant.api import Listed, RobotApi
from rwt_participant.errors import UnknownType
from rwt_participant.future import run_until_it_waits
from rwt_participant.handles import Handle
from rwt_participant.messages import RawMessage
from rwt_participant.qos import QoS
from rwt_participant.timers import Timer
from rwt_transports.http.routes import MetricFamily

logger = logging.getLogger(__name__)

LOOK_SECONDS: Final = 0.2
"""Interval in which a graph is searched for new topics, in seconds."""

HIDDEN_LOOKS: Final = 5
"""Every so many looks, hidden topics are included, which a connected robot must be asked for by name."""

EARLIER_NS: Final = 1_500_000_000
"""Nanoseconds: a topic is latched if its first message is older than the subscription by more than this.
Servers also retain the first second of every publisher, so a younger message proves nothing."""

_MESSAGE_BYTES: Final = 31
"""Bytes of a message in MCAP besides its payload (record Message)."""

_STATIC_TRANSFORMS: Final = "/tf_static"
_KNOWN_LATCHED: Final = (_STATIC_TRANSFORMS, "/robot_description")

_REMEMBERED: Final = 100
"""Number of remembered stamps of a latched topic."""


class Recorder:
    """Recorder of a robot's topics until it is stopped.

    A message's publish time is the robot's time of publishing. Its log time is the same, but not before the
    recording began: retained messages are logged first. If a server sends no stamps, both are the time of
    arrival by this computer's clock.

    Args:
        offered_qos: returns the QoS that the publishers of a topic offer; None if that is unknown. It is then
            inferred from the age of the first message, and repeated messages are dropped: a server sends
            retained ones again after a lost connection.
        node: node that records; its own subscriptions do not keep a topic alive.
        on_stop: called once when the recording stops.

    Attributes:
        is_full: True if `largest_bytes` was reached, which stops the recording.
    """

    def __init__(
        self,
        robot: RobotApi,
        writer: RecordingWriter,
        selection: TopicSelection = EVERYTHING,
        *,
        offered_qos: Callable[[str], tuple[QoS, ...] | None] = lambda topic: None,
        node: str = "",
        on_stop: Callable[[], None] = lambda: None,
    ) -> None:
        self.writer = writer
        self.is_full = False
        self._robot = robot
        self._selection = selection
        self._encoding = writer.options.encoding
        self._room = writer.options.largest_bytes or None
        self._offered_qos = offered_qos
        self._node = node
        self._on_stop: Callable[[], None] | None = on_stop
        self._began_ns = 0
        self._looks = 0
        self._topics: dict[str, _RecordedTopic] = {}
        self._rejected: dict[str, str | None] = {}
        self._timer: Timer | None = None

    @property
    def topics(self) -> int:
        """Number of topics with a subscription."""
        return sum(each.handle is not None for each in self._topics.values())

    async def look(self) -> None:
        """Record new topics.

        Raises:
            RobotError: the robot does not list its topics.
        """
        asked_ns = await self._robot.time_ns()
        self._began_ns = self._began_ns or asked_ns
        hidden = (self._selection.services or self._selection.actions) and self._looks % HIDDEN_LOOKS == 0
        for topic in await self._robot.topics(hidden=hidden):
            if self._selection.takes(topic.name):
                await self._follow(topic, asked_ns)
        self._looks += 1

    def look_now(self) -> None:
        """Record the topics of a graph that are new; to be called on its thread."""
        run_until_it_waits(self.look())  # The listings of a graph never wait.

    def keep_looking(self) -> None:
        """Record the topics of a graph, and new ones every :data:`LOOK_SECONDS`."""
        self.look_now()
        self._timer = self._robot.clock.call_later(LOOK_SECONDS, self.keep_looking)

    async def _follow(self, topic: Listed, asked_ns: int) -> None:
        known = self._topics.get(topic.name)
        # The subscription of a node follows the topic. It has no type, which would be kept for others.
        wanted = topic.type if topic.publishers is None else None
        if known is not None and known.handle is not None and known.type == wanted:
            if self._is_alone(topic):
                known.close()
            return
        if wanted == "" or (topic.name in self._rejected and self._rejected[topic.name] == wanted):
            return
        if known is None or known.type != wanted:
            if known is not None:
                known.close()
            known = self._topics[topic.name] = _RecordedTopic(self, topic.name, wanted, asked_ns)
        try:
            known.handle = await self._robot.subscribe_raw(topic.name, known.receive, wanted)
        except UnknownType as error:
            del self._topics[topic.name]
            self._rejected[topic.name] = wanted
            logger.warning("%s is not recorded: %s", topic.name, error)
            return
        logger.debug("recording %s (%s)", topic.name, topic.type)

    def _is_alone(self, topic: Listed) -> bool:
        """Return True if nothing but this recorder uses a topic, which must not keep it alive."""
        if topic.publishers is None or topic.subscribers is None:
            return False
        return not topic.publishers and all(each.node == self._node for each in topic.subscribers)

    def record(self, channel: RecordedChannel, message: RawMessage, stamp_ns: int | None) -> None:
        """Write one message.

        Args:
            stamp_ns: time of publishing; None for the time of arrival.
        """
        data = message.data if self._encoding == "ros" else _json(message, channel.form.topic)
        if data is None or not self._takes(len(data) + _MESSAGE_BYTES):
            return
        if stamp_ns is None:
            published = logged = time.time_ns()
        else:
            published, logged = stamp_ns, max(stamp_ns, self._began_ns)
        self.writer.write(channel, logged, published, data)

    def _takes(self, size: int) -> bool:
        """Return True if so many more bytes fit; otherwise, stop the recording."""
        if self._room is None:
            return True
        if self.is_full or size > self._room:
            if not self.is_full:
                self.is_full = True
                # Not from within a delivery to one of the subscriptions that this closes.
                self._robot.clock.call_later(0.0, self.stop)
            return False
        self._room -= size
        return True

    def offered_qos(self, topic: str, *, is_earlier: bool) -> tuple[QoS, ...]:
        """Return the QoS to note for a topic.

        Args:
            is_earlier: True if the topic's first message was published before the subscription.
        """
        known = self._offered_qos(topic)
        if known is not None:
            return known
        if topic == _STATIC_TRANSFORMS:
            return (KEPT_TRANSFORMS,)
        return (KEPT,) if is_earlier or topic in _KNOWN_LATCHED else ()

    def begin_channel(self, topic: str, message: RawMessage, offered_qos: tuple[QoS, ...]) -> RecordedChannel:
        """Begin a channel for a topic and the type of its message."""
        form = channel_form(topic, message.type, self._encoding, offered_qos)
        self._takes(len(form.schema) + sum(len(value) for value in form.metadata.values()))
        return self.writer.add_channel(form)

    def stop(self) -> None:
        """End all subscriptions; received messages are still written. To be called on the robot's thread."""
        on_stop, self._on_stop = self._on_stop, None
        if on_stop is None:
            return
        if self._timer is not None:
            self._timer.cancel()
        for topic in self._topics.values():
            topic.close()
        on_stop()

    def close(self) -> None:
        """Stop, finish the file and wait until it is written. No-op if it is closed.

        Raises:
            RecordingNotWritten: not everything could be written.
        """
        self.stop()
        self.writer.close()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def failure_metric(name: str, problems: Callable[[], Sequence[str]]) -> tuple[MetricFamily]:
    """Return the metric of a recorder that reports its problems."""
    return (
        MetricFamily(name, "gauge", "1 if the last recording could not be written.", [({}, len(problems()))]),
    )


def record_graph(
    graph: Graph,
    path: Path,
    selection: TopicSelection = EVERYTHING,
    options: RecordingOptions = DEFAULT_OPTIONS,
    *,
    name: str = "recorder",
) -> Recorder:
    """Record the topics of a graph; begins at once, also before the graph runs.

    Raises:
        RecordingNotWritten: the file cannot be created.
        ExtraMissing: the extra ``mcap`` is not installed.
    """

    def offered_qos(topic: str) -> tuple[QoS, ...]:
        info = graph.topic(topic)
        return () if info is None else tuple(publisher.qos for publisher in info.publishers)

    writer = RecordingWriter(path, graph.distro, options)
    robot = GraphRobot(graph, name)
    recorder = Recorder(
        robot, writer, selection, offered_qos=offered_qos, node=robot.name, on_stop=robot.close
    )
    recorder.keep_looking()
    return recorder


@dataclass(eq=False, slots=True)
class _RecordedTopic:
    """Subscription to one topic, with a channel for each type that it has had.

    Attributes:
        type: type name of the subscription; None if it follows the topic of a graph.
        handle: subscription; None while the topic has no other users.
    """

    recorder: Recorder
    name: str
    type: str | None
    asked_ns: int
    handle: Handle | None = None
    channels: dict[str, RecordedChannel] = field(default_factory=dict)
    stamps: dict[int, None] | None = None

    def receive(self, message: RawMessage) -> None:
        stamp = message.stamp_ns
        channel = self.channels.get(message.type.name) or self._begin(message)
        if self.stamps is None or stamp is None or not self._is_repeated(self.stamps, stamp):
            self.recorder.record(channel, message, stamp)

    def _begin(self, message: RawMessage) -> RecordedChannel:
        stamp = message.stamp_ns
        is_earlier = stamp is not None and stamp + EARLIER_NS < self.asked_ns
        offered = self.recorder.offered_qos(self.name, is_earlier=is_earlier)
        if offered and self.type is not None:
            self.stamps = {}
        channel = self.recorder.begin_channel(self.name, message, offered)
        self.channels[message.type.name] = channel
        return channel

    def _is_repeated(self, stamps: dict[int, None], stamp: int) -> bool:
        if stamp in stamps:
            return True
        stamps[stamp] = None
        if len(stamps) > _REMEMBERED:
            del stamps[next(iter(stamps))]
        return False

    def close(self) -> None:
        handle, self.handle = self.handle, None
        if handle is not None:
            handle.close()


def _json(message: RawMessage, topic: str) -> bytes | None:
    try:
        return bytes(Payload.deserialised(message.type, message.data).json())
    except InvalidMessage as error:
        logger.warning("a message on %s is left out: %s", topic, error)
        return None
