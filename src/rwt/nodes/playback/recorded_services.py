"""Recorded services: service calls get the responses of the recording.

Requests and responses are in the topics of service introspection of ROS 2, `/NAME/_service_event`. A request
equal to a recorded one gets the recorded response; repeated requests get theirs in order, then the last one
again. Any other request fails.
"""

from __future__ import annotations

import logging
from typing import Any, Final

from rwt.nodes.playback.publications import read_payload
from rwt.nodes.recording.recording import RecordedMessage, RecordedTopic, Recording, TopicSelection
from rwt_graph.api import Graph, ServiceCall
from rwt_interfaces import InterfaceError, InvalidMessage, Payload
from rwt_interfaces.structs import MessageType, ServiceType
from rwt_participant.api import ACTION_PARTS, SERVICE_EVENTS

logger = logging.getLogger(__name__)

_EVENT: Final = "_Event"
_REQUESTS: Final = (0, 1)
"""`event_type` of REQUEST_SENT and REQUEST_RECEIVED; the two others are responses."""


class RecordedServices:
    """Server of every service whose calls were recorded with contents, and that no node provides."""

    def __init__(self, graph: Graph, recording: Recording, selection: TopicSelection, node: str) -> None:
        self._graph = graph
        self._recording = recording
        self._participant = graph.participant(node)
        for topic in recording.topics:
            is_call = topic.name.endswith(SERVICE_EVENTS) and ACTION_PARTS not in topic.name
            if is_call and selection.takes(topic.name):
                self._offer(topic)

    def _offer(self, topic: RecordedTopic) -> None:
        name = topic.name.removesuffix(SERVICE_EVENTS)
        registry = self._graph.registry
        try:
            event = registry.message(topic.type)
            service = registry.service(topic.type.removesuffix(_EVENT))
        except InterfaceError as error:
            logger.warning("calls of %s are not answered: %s", name, error)
            return
        answers = _RecordedCalls(name, service)
        for message in self._recording.messages([topic.name]):
            answers.learn(topic, event, message)
        if answers.known and self._graph.service(name) is None:
            self._participant.advertise_service(name, service, answers.answer)

    def close(self) -> None:
        """Withdraw the services."""
        self._participant.close()


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
