"""The topics of a recording in a graph: publishers, and recorded bytes made into messages again."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rwt_graph.names import resolve
from rwt_interfaces import InterfaceError, InvalidMessage, Payload
from rwt_nodes.recording.recorded_qos import combined
from rwt_nodes.recording.selection import TopicSelection

if TYPE_CHECKING:
    from rwt_graph.api import Participant, Publisher
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import MessageType
    from rwt_nodes.recording.recording import MessageEncoding, RecordedMessage, RecordedTopic, Recording

logger = logging.getLogger(__name__)

_READERS: Mapping[str, Callable[[MessageType, bytes], Payload]] = {
    "cdr": Payload.from_cdr,
    "ros1": Payload.from_ros1,
    "json": Payload.from_json,
}


@dataclass(frozen=True, slots=True)
class _Publication:
    publisher: Publisher
    type: MessageType
    read: Callable[[MessageType, bytes], Payload]


class Publications:
    """Publishes what was recorded.

    Args:
        participant: whose publishers these are.
        registry: which knows the recording's types.
        recording: whose topics are advertised, at once.
        selection: which of them.
        remap: names to publish under, by recorded name.

    Attributes:
        skipped: why topics are not played, by name.
        misfits: messages that could not be read.

    Raises:
        TypeConflict: a topic is established with another type in this graph.
    """

    def __init__(
        self,
        participant: Participant,
        registry: Registry,
        recording: Recording,
        selection: TopicSelection,
        remap: Mapping[str, str],
    ) -> None:
        self.skipped: dict[str, str] = {}
        self.misfits = 0
        self._participant = participant
        self._registry = registry
        self._remap = {resolve(old): resolve(new) for old, new in remap.items()}
        self._by_topic: dict[tuple[str, str], _Publication] = {}
        for topic in recording.topics:
            if selection.takes(topic.name):
                self._advertise(topic)
        for name, why in self.skipped.items():
            logger.warning("%s is not played: %s", name, why)

    @property
    def topics(self) -> frozenset[str]:
        """The recorded names of what is played."""
        return frozenset(name for name, _ in self._by_topic)

    def kept(self) -> dict[str, int]:
        """The recorded names of topics whose messages are kept for late joiners, and how many are kept."""
        return {
            name: each.publisher.qos.depth
            for (name, _), each in self._by_topic.items()
            if each.publisher.qos.durability.value == "transient_local"
        }

    def _advertise(self, topic: RecordedTopic) -> None:
        read = _READERS.get(topic.encoding)
        if read is None:
            self.skipped[topic.name] = "its messages are in an encoding that is not known here"
            return
        if any(name == topic.name for name, _ in self._by_topic):
            self.skipped[topic.name] = f"as {topic.type}: it was recorded with another type, too"
            return
        try:
            message = self._registry.message(topic.type)
        except InterfaceError as error:
            self.skipped[topic.name] = str(error)
            return
        name = self._remap.get(topic.name, topic.name)
        publisher = self._participant.advertise(name, message, combined(topic.offered_qos))
        self._by_topic[topic.name, topic.type] = _Publication(publisher, message, read)

    def publish(self, message: RecordedMessage) -> bool:
        """Publish one message; False if it is of a topic that is not played, or cannot be read."""
        publication = self._by_topic.get((message.topic, message.type))
        if publication is None:
            return False
        try:
            payload = publication.read(publication.type, message.data)
        except InvalidMessage as error:
            self.misfits += 1
            logger.warning("a message on %s is left out: %s", message.topic, error)
            return False
        publication.publisher.publish(payload)
        return True


def read_payload(encoding: MessageEncoding, message: MessageType, data: bytes) -> Payload:
    """A recorded message; raises InvalidMessage if it does not fit."""
    return _READERS[encoding](message, data)


__all__ = ["Publications", "read_payload"]
