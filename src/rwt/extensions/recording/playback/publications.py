"""Topics and services of a recording in a graph: types, publishers, and responses to calls.

Requests and responses of services are in the topics of service introspection of ROS 2,
`/NAME/_service_event`. A request equal to a recorded one gets the recorded response; repeated requests get
theirs in order, then the last one again. Any other request fails.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from rwt.extensions.recording.channels import combined
from rwt.extensions.recording.recording import MessageEncoding, RecordedMessage, RecordedTopic, Recording
from rwt_graph.api import Graph, Participant, Publisher, ServiceCall
from rwt_graph.names import resolve
from rwt_graph.topic_selection import TopicSelection
from rwt_interfaces import InterfaceError, InvalidMessage, Payload
from rwt_interfaces.definitions.parser import parse_message
from rwt_interfaces.names import two_part
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType, ServiceType
from rwt_participant.api import ACTION_PARTS, SERVICE_EVENTS
from rwt_participant.errors import RobotError

logger = logging.getLogger(__name__)

_READERS: Mapping[str, Callable[[MessageType, bytes], Payload]] = {
    "cdr": Payload.from_cdr,
    "ros1": Payload.from_ros1,
    "json": partial(Payload.from_json, is_trusted=True),
}


@dataclass(frozen=True, slots=True)
class _Publication:
    publisher: Publisher
    type: MessageType
    read: Callable[[MessageType, bytes], Payload]


class Publications:
    """Publishers of the topics of a recording.

    Args:
        remap: published names by recorded name.

    Attributes:
        skipped: reasons why topics are not played, by name.
        unreadable: number of messages that could not be read.
    """

    def __init__(
        self,
        graph: Graph,
        participant: Participant,
        recording: Recording,
        selection: TopicSelection,
        remap: Mapping[str, str],
    ) -> None:
        self.skipped: dict[str, str] = {}
        self.unreadable = 0
        self._participant = participant
        self._graph = graph
        self._remap = {resolve(old): resolve(new) for old, new in remap.items()}
        self._by_topic: dict[tuple[str, str], _Publication] = {}
        for topic in recording.topics:
            if selection.takes(topic.name):
                self._advertise(topic)
        for name, why in self.skipped.items():
            logger.warning("%s is not played: %s", name, why)

    @property
    def topics(self) -> frozenset[str]:
        """Recorded names of the topics that are played."""
        return frozenset(name for name, _ in self._by_topic)

    def kept(self) -> dict[str, int]:
        """Recorded names of latched topics, each with its history depth."""
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
            message = self._graph.registry.message(topic.type)
        except InterfaceError as error:
            self.skipped[topic.name] = str(error)
            return
        name = self._remap.get(topic.name, topic.name)
        if self._graph.is_reserved(name):
            self.skipped[topic.name] = f"only this server publishes on {name}"
            return
        try:
            publisher = self._participant.advertise(name, message, combined(topic.offered_qos))
        except RobotError as error:  # a bad name or type must not prevent playing the others
            self.skipped[topic.name] = str(error)
            return
        self._by_topic[topic.name, topic.type] = _Publication(publisher, message, read)

    def publish(self, message: RecordedMessage) -> bool:
        """Publish one message. Returns False if its topic is not played, or if it cannot be read."""
        publication = self._by_topic.get((message.topic, message.type))
        if publication is None:
            return False
        try:
            payload = publication.read(publication.type, message.data)
        except InvalidMessage as error:
            self.unreadable += 1
            logger.warning("a message on %s is left out: %s", message.topic, error)
            return False
        publication.publisher.publish(payload)
        return True


def read_payload(encoding: MessageEncoding, message: MessageType, data: bytes) -> Payload:
    """Return a recorded message; raises InvalidMessage if it does not fit its type."""
    return _READERS[encoding](message, data)


_SEPARATOR: Final = "=" * 80
_EVENT: Final = "_Event"


def add_recorded_types(registry: Registry, recording: Recording) -> None:
    """Add the types of a recording to a registry; those of the recording win.

    Types handed out before do not change. A definition that cannot be read is logged and left out.
    """
    for topic in recording.topics:
        if topic.definition:
            try:
                _add_types(registry, topic.type, topic.definition)
            except InterfaceError as error:
                logger.warning("the definition of %s in the recording is not used: %s", topic.type, error)


def _add_types(registry: Registry, name: str, text: str) -> None:
    root, *nested = text.replace("\r\n", "\n").split(f"{_SEPARATOR}\n")
    texts = {two_part(name): root.rstrip("\n")}
    for section in nested:
        head, _, body = section.partition("\n")
        texts[two_part(head.removeprefix("MSG:").strip())] = body.rstrip("\n")
    if name.endswith(_EVENT) and "/srv/" in name:
        _add_service(registry, two_part(name).removesuffix(_EVENT), texts)
    for each, definition in texts.items():
        if not _known(registry, each, definition):
            registry.add_text(definition, each)


def _add_service(registry: Registry, name: str, texts: dict[str, str]) -> None:
    """Add a service type, derived from the event message of service introspection."""
    request, response = texts.get(f"{name}_Request"), texts.get(f"{name}_Response")
    if request is None or response is None:
        return
    if _known(registry, f"{name}_Request", request) and _known(registry, f"{name}_Response", response):
        return
    registry.add_text(f"{request}\n---\n{response}", name, "srv")


def _known(registry: Registry, name: str, text: str) -> bool:
    known = registry.known_definition(name)
    return known is not None and known == parse_message(text, name, distro=registry.distro)


_REQUESTS: Final = (0, 1)
"""`event_type` of REQUEST_SENT and REQUEST_RECEIVED; the two others are responses."""


def offer_recorded_services(
    graph: Graph, participant: Participant, recording: Recording, selection: TopicSelection
) -> None:
    """Offer every service whose calls were recorded with contents, and that no node provides."""
    for topic in recording.topics:
        is_call = topic.name.endswith(SERVICE_EVENTS) and ACTION_PARTS not in topic.name
        if is_call and selection.takes(topic.name):
            _offer(graph, participant, recording, topic)


def _offer(graph: Graph, participant: Participant, recording: Recording, topic: RecordedTopic) -> None:
    name = topic.name.removesuffix(SERVICE_EVENTS)
    registry = graph.registry
    try:
        event = registry.message(topic.type)
        service = registry.service(topic.type.removesuffix(_EVENT))
    except InterfaceError as error:
        logger.warning("calls of %s are not answered: %s", name, error)
        return
    answers = _RecordedCalls(name, service)
    for message in recording.messages([topic.name]):
        answers.learn(topic, event, message)
    if answers.known and graph.service(name) is None:
        participant.advertise_service(name, service, answers.answer)


class _RecordedCalls:
    """Recorded responses of one service, by the CDR of the request."""

    def __init__(self, name: str, service: ServiceType) -> None:
        self._name = name
        self._service = service
        self._open: dict[tuple[bytes, int], bytes] = {}
        self._responses: dict[bytes, list[Payload]] = {}
        self._asked: dict[bytes, int] = {}

    @property
    def known(self) -> int:
        return len(self._responses)

    def learn(self, topic: RecordedTopic, event: MessageType, message: RecordedMessage) -> None:
        try:
            recorded: Any = read_payload(topic.encoding, event, message.data).value()
            call = (bytes(recorded.info.client_gid), recorded.info.sequence_number)
            if recorded.info.event_type in _REQUESTS:
                for request in recorded.request:
                    self._open[call] = Payload.from_value(self._service.request, request).cdr()
                return
            for response in recorded.response:
                # Client and server may both have published a call: the second event finds nothing open.
                asked = self._open.pop(call, None)
                if asked is not None:
                    payload = Payload.from_value(self._service.response, response)
                    self._responses.setdefault(asked, []).append(payload)
        except InvalidMessage as error:
            logger.warning("a recorded call of %s is left out: %s", self._name, error)

    def answer(self, call: ServiceCall) -> None:
        try:
            request = call.request.cdr()
        except InvalidMessage as error:
            call.fail(str(error))
            return
        responses = self._responses.get(request)
        if responses is None:
            call.fail(f"the recording has no call of {self._name} with this request")
            return
        turn = self._asked.get(request, 0)
        self._asked[request] = turn + 1
        call.reply(responses[min(turn, len(responses) - 1)])
