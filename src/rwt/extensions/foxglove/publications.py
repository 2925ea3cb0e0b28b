"""Channels that one client advertises, and their messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from rwt.access.client_graph import ClientGraph, ClientPublisher
from rwt.access.errors import AccessError
from rwt.extensions.foxglove.errors import NotPossible
from rwt.extensions.foxglove.replies import FoxgloveReplies
from rwt.extensions.foxglove.wire.client_messages import ClientChannel, MessageData
from rwt.extensions.foxglove.wire.payloads import check_encoding, is_long, payload_of
from rwt.extensions.foxglove.wire.server_messages import Level
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.steps import Steps, finished
from rwt_participant.errors import RobotError


class _Announced(NamedTuple):
    """Channel of a client, with its publisher."""

    channel: ClientChannel
    topic: str
    publisher: ClientPublisher


class ClientChannels:
    """Channels that one client has advertised, by its ids; `structure` limits the brackets of its JSON."""

    def __init__(self, graph: ClientGraph, replies: FoxgloveReplies, structure: int) -> None:
        self._graph = graph
        self._replies = replies
        self._structure = structure
        self._now: Final[Callable[[], int]] = graph.clock.time_ns
        self._by_id: dict[int, _Announced] = {}

    def advertise(self, channel: ClientChannel) -> None:
        """Advertise a topic for the client.

        Raises:
            NotPossible: the id is in use, or the encoding is not supported.
            RobotError, AccessError: as :meth:`ClientGraph.advertise`.
        """
        if channel.id in self._by_id:
            raise NotPossible(f"advertise: channel {channel.id} is advertised already; take another id")
        check_encoding(channel.encoding, self._graph.distro)
        topic = self._graph.advertise(channel.topic, channel.schema_name, channel.id)
        try:
            publisher = self._graph.publisher(topic, channel.schema_name, channel.id)
        except BaseException:
            # Otherwise the advertisement would count against the quota, without an id to withdraw it.
            self._graph.unadvertise(topic, channel.id)
            raise
        self._by_id[channel.id] = _Announced(channel, topic, publisher)

    def unadvertise(self, id: int) -> None:
        """Withdraw a channel. Raises NotPossible for an unknown id."""
        announced = self._by_id.pop(id, None)
        if announced is None:
            raise NotPossible(f"unadvertise: this client advertises no channel {id}")
        self._graph.unadvertise(announced.topic, id)

    def publish(self, message: MessageData) -> Steps[None] | None:
        """Validate a message once and publish it; long JSON in the returned steps.

        Raises:
            NotPossible: unknown channel, or the message does not fit its type.
            QuotaExceeded: `limits.kept_bytes` is reached.
        """
        announced = self._of(message)
        steps = self._publish(message, announced)
        if is_long(announced.channel.encoding, message.data):
            return steps
        finished(steps)
        return None

    def topic_of(self, channel_id: int) -> str:
        """Return the topic of a channel; empty if the client has no such channel."""
        announced = self._by_id.get(channel_id)
        return "" if announced is None else announced.topic

    def _of(self, message: MessageData) -> _Announced:
        announced = self._by_id.get(message.channel_id)
        if announced is None:
            raise NotPossible(f"message data: this client advertises no channel {message.channel_id}")
        return announced

    def _publish(self, message: MessageData, announced: _Announced) -> Steps[None]:
        size = len(message.data)
        type, encoding = announced.publisher.type, announced.channel.encoding
        try:
            payload = yield from payload_of(type, encoding, message.data, self._now, self._structure)
        except InvalidMessage as error:
            raise NotPossible(f"message data on {announced.topic}: {error}") from None
        # The client's role may have changed meanwhile, and the channel may be closed.
        present = self._of(message)
        if present.channel is not announced.channel:
            raise NotPossible(f"message data: channel {message.channel_id} has become another one")
        counts = present.publisher.counts
        counts.received += 1
        counts.received_bytes += size
        present.publisher.publish(payload)

    def on_ended(self, _kind: str, topic: str, reason: str) -> None:
        """Close the channels of a topic that the robot uses with another type."""
        for id in [id for id, announced in self._by_id.items() if announced.topic == topic]:
            del self._by_id[id]
            self._replies.say(Level.ERROR, f"channel {id} has ended: {reason}")

    def ask_again(self) -> None:
        """Check the right to publish on each channel after a change of role, and close those that are not
        allowed.
        """
        for id, announced in tuple(self._by_id.items()):
            del self._by_id[id]
            try:
                self.advertise(announced.channel)
            except (RobotError, AccessError, NotPossible) as error:
                self._graph.unadvertise(announced.topic, id)
                self._replies.say(Level.WARNING, f"channel {id} has ended: {error}")
