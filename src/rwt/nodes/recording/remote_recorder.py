"""Records a robot over its rosbridge server: topics as they appear, undecoded, with the server's stamps."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from rwt.nodes.recording.channels import KEPT, KEPT_TRANSFORMS, channel_form
from rwt.nodes.recording.selection import TopicSelection
from rwt_client import ConnectionLost

from rwt_interfaces import InterfaceError, InvalidMessage, Payload
from rwt_participant.api import ACTION_PARTS, SERVICE_EVENTS
from rwt_participant.errors import RobotError, UnknownType
from rwt_participant.messages import RawMessage
from rwt_participant.rosapi_parameters import UNANSWERED

if TYPE_CHECKING:
    from rwt.nodes.recording.channels import Encoding
    from rwt.nodes.recording.writer import RecordedChannel, RecordingWriter
    from rwt_client import Robot
    from rwt_client.endpoints.raw_subscription import RawSubscription
    from rwt_interfaces.structs import MessageType
    from rwt_participant.qos import QoS

logger = logging.getLogger(__name__)

EARLIER_NS: Final = 1_500_000_000
"""Nanoseconds: a topic is latched if its first message is older than the subscription by more than this.
Servers also keep the first second of every publisher, so a younger one proves nothing."""

_KNOWN_KEPT: Final = ("/tf_static", "/robot_description")
_ACTION_TOPICS: Final = (
    "feedback", "status", f"send_goal{SERVICE_EVENTS}", f"get_result{SERVICE_EVENTS}",
)  # fmt: skip

HIDDEN_POLLS: Final = 5
"""Hidden topics are asked for with every so many polls."""

_REMEMBERED: Final = 100

class RemoteRecorder:
    """Writes the topics of a connected robot.

    A message's publish time is the server's stamp; its log time is the same, but not before the recording
    began. From a server that sends no stamps both are the time of arrival by this machine's clock.

    Args:
        robot: connected, and with rosapi.
        writer: of the file; it is not closed here.
        latched: whether the topic of that name is known to be latched.
    """

    def __init__(
        self,
        robot: Robot,
        writer: RecordingWriter,
        selection: TopicSelection,
        encoding: Encoding,
        latched: Callable[[str], bool],
    ) -> None:
        self.robot = robot
        self.writer = writer
        self.encoding: Encoding = encoding
        self.began_ns = 0
        self._selection = selection
        self._latched = latched
        self._topics: dict[str, _RemoteTopic] = {}
        self._refused: dict[str, str] = {}
        self._polls = 0

    @property
    def topics(self) -> int:
        """How many topics are subscribed to."""
        return len(self._topics)

    async def poll(self) -> None:
        """Record the topics that are new. Does nothing while there is no connection.

        Raises:
            RobotError: the robot does not answer what its topics are.
        """
        with suppress(ConnectionLost):
            asked_ns = await self.robot.time_ns()
            self.began_ns = self.began_ns or asked_ns
            for topic in await self.robot.api.topics():
                if topic.type and self._selection.takes(topic.name):
                    await self._take(topic.name, topic.type, asked_ns)
            if self._polls % HIDDEN_POLLS == 0:
                await self._poll_hidden(asked_ns)
            self._polls += 1

    async def _poll_hidden(self, asked_ns: int) -> None:
        """Ask for the topics of service introspection and actions by name: lists leave them out (API-02)."""
        for name in await self._hidden_names():
            if name not in self._topics and self._selection.takes(name):
                with suppress(*UNANSWERED):
                    type_name = await self.robot.api.topic_type(name)
                    if type_name:
                        await self._take(name, type_name, asked_ns)

    async def _hidden_names(self) -> list[str]:
        """The names that hidden topics would have."""
        names: list[str] = []
        if self._selection.services:
            services = await self.robot.api.services()
            names += [f"{name}{SERVICE_EVENTS}" for name in services if not name.startswith("/rosapi/")]
        if self._selection.actions and self.robot.types.registry.distro.action_transport == "services":
            with suppress(*UNANSWERED):  # Servers that do not know of actions.
                actions = await self.robot.api.action_servers()
                names += [f"{name}{ACTION_PARTS}{part}" for name in actions for part in _ACTION_TOPICS]
        return names

    async def _take(self, name: str, type_name: str, asked_ns: int) -> None:
        known = self._topics.get(name)
        if self._refused.get(name) == type_name or (known is not None and known.type_name == type_name):
            return
        if known is not None:
            known.close()
        try:
            await self._learn(type_name)
            recorded = _RemoteTopic(self, name, type_name, asked_ns)
            recorded.subscription = await self.robot.subscribe_raw(name, recorded.receive, type_name)
        except UnknownType as error:
            self._refused[name] = type_name
            logger.warning("%s is not recorded: %s", name, error)
            return
        self._topics[name] = recorded
        logger.debug("recording %s (%s)", name, type_name)

    async def _learn(self, type_name: str) -> None:
        """Take the robot's definition of a type with its comments and constants, if it sends any."""
        try:
            self.robot.types.registry.message(type_name)
        except InterfaceError:
            with suppress(RobotError):
                await self.robot.types.refresh()

    def offered_qos(self, name: str, earlier: bool) -> tuple[QoS, ...]:
        """The QoS to record: transient local for a latched topic, none for any other."""
        if name == _KNOWN_KEPT[0]:
            return (KEPT_TRANSFORMS,)
        return (KEPT,) if earlier or name in _KNOWN_KEPT or self._latched(name) else ()

    def close(self) -> None:
        """End all subscriptions."""
        for topic in self._topics.values():
            topic.close()

class _RemoteTopic:
    """One topic of one type."""

    def __init__(self, recorder: RemoteRecorder, name: str, type_name: str, asked_ns: int) -> None:
        self.type_name = type_name
        self.subscription: RawSubscription | None = None
        self._recorder = recorder
        self._name = name
        self._asked_ns = asked_ns
        self._channel: RecordedChannel | None = None
        # Stamps of messages that a server sends again when a lost connection is restored.
        self._latched_stamps: dict[int, None] | None = None

    def receive(self, message: RawMessage) -> None:
        """Record one message."""
        recorder, stamp = self._recorder, message.stamp_ns
        channel = self._channel or self._begin(stamp)
        if stamp is None:
            published = logged = time.time_ns()
        elif self._latched_stamps is not None and self._is_repeated(stamp):
            return
        else:
            published, logged = stamp, max(stamp, recorder.began_ns)
        data = message.data if recorder.encoding == "ros" else self._json(message.data)
        if data is not None:
            recorder.writer.write(channel, logged, published, data)

    @property
    def _type(self) -> MessageType:
        return self._recorder.robot.types.registry.message(self.type_name)

    def _begin(self, stamp: int | None) -> RecordedChannel:
        earlier = stamp is not None and stamp + EARLIER_NS < self._asked_ns
        offered = self._recorder.offered_qos(self._name, earlier)
        form = channel_form(self._name, self._type, self._recorder.encoding, offered)
        channel = self._channel = self._recorder.writer.add_channel(form)
        self._latched_stamps = {} if offered else None
        return channel

    def _is_repeated(self, stamp: int) -> bool:
        stamps = self._latched_stamps
        assert stamps is not None  # Asked of latched topics only.
        if stamp in stamps:
            return True
        stamps[stamp] = None
        if len(stamps) > _REMEMBERED:
            del stamps[next(iter(stamps))]
        return False

    def _json(self, data: bytes | memoryview) -> bytes | None:
        try:
            payload = Payload.deserialised(self._type, data)
        except InvalidMessage as error:
            logger.warning("a message on %s is left out: %s", self._name, error)
            return None
        return bytes(payload.json())

    def close(self) -> None:
        """End the subscription."""
        if self.subscription is not None:
            self.subscription.close()
