"""Publishing on topics."""

from __future__ import annotations

import logging
import time
from collections import deque
from contextlib import suppress
from typing import Any, Final, TypedDict

from rwt_client.endpoints.remote_handle import ClientConnection, RemoteHandle
from rwt_client.endpoints.services import call_service
from rwt_client.errors import ConnectionLost, MessageRejected, ServerRefused
from rwt_client.events import ConnectionEvent
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import HandleClosed, InvalidMessage, ProviderNotFound, RobotError, ServiceFailed
from rwt_participant.future import USUAL, Timeout
from rwt_participant.handles import Publisher
from rwt_participant.messages import MessageLike, to_payload
from rwt_participant.qos import QoS
from rwt_protocol.codecs.json import publish_frame, publish_prefix
from rwt_protocol.ops import Advertise, Qos, Unadvertise
from rwt_protocol.payloads import RawJson
from rwt_transports.endpoint import DropReason, Flow

logger = logging.getLogger("rwt_client")

_MOST_PENDING: Final = 100
"""Maximum number of messages queued until the topic's type is known; beyond it, the oldest are dropped."""

_LOG_SECONDS: Final = 1.0
"""Minimum time between two log lines about rejected messages of one publisher, for the same reason."""


class AdvertiseOptions(TypedDict, total=False):
    """Options of an advertisement.

    Attributes:
        latch: retain the last message for late subscribers.
        queue_size: messages queued for slow subscribers, on ROS 1 servers.
        qos: quality of service, on ROS 2 servers.
    """

    latch: bool
    queue_size: int | None
    qos: QoS | Qos | None


def wire_qos(qos: QoS | Qos | None) -> Qos | None:
    """Return the QoS in the form of the wire; a model of the wire is returned unchanged."""
    if not isinstance(qos, QoS):
        return qos
    return Qos(
        history=qos.history.value,
        depth=qos.depth,
        reliability=qos.reliability.value,
        durability=qos.durability.value,
        deadline=qos.deadline,
        lifespan=qos.lifespan,
    )


class RemotePublisher(RemoteHandle[MessageType], Publisher):
    """Publisher of one topic until :meth:`close`; advertised again after a reconnection.

    Attributes:
        sent: number of messages published.
        dropped: number of those that were dropped because the network was too slow, or the topic's type was
            unknown for too long.
        rejected: number of messages that the server has rejected so far.
        rejection: first rejection since the last :meth:`confirm`, which raises it.
        error: reason that :meth:`publish` rejects every message; None while messages are accepted.
    """

    _message_type: MessageType
    _wire_type: str

    def __init__(self, connection: ClientConnection, name: str, options: AdvertiseOptions) -> None:
        super().__init__(connection, "advertise", name)
        self.sent = 0
        self.dropped = 0
        self.rejected = 0
        self.rejection: MessageRejected | None = None
        self._logged = ("", 0.0)
        self._options = AdvertiseOptions(**{**options, "qos": wire_qos(options.get("qos"))})
        self._messages_id = connection.session.next_id("publish", name)
        self._prefix = publish_prefix(name, self._messages_id)
        self._flow: Flow | None = None
        self.error: RobotError | None = None
        self._pending: deque[MessageLike] = deque()
        self._invalid: InvalidMessage | None = None

    def publish(self, message: MessageLike) -> None:
        """Publish one message without waiting; if the network is slower, the oldest queued ones are dropped.

        The server's verdict comes later: a rejection is logged and counted, and :meth:`confirm` raises it.

        Raises:
            InvalidMessage: it does not fit the type; raised by `await` while the type is unknown.
            ServerRefused: the server rejected the advertisement; with its text.
            NotConnected: there is no connection now.
            HandleClosed: this publisher was closed.
            ConnectionClosed: the connection was closed.
        """
        checked = self.checked(message)
        if self._flow is not None and isinstance(checked, Payload):
            self._flow.send(publish_frame(self._prefix, checked.json()))
            self.sent += 1
            return
        if len(self._pending) == _MOST_PENDING:
            self._pending.popleft()
            self.dropped += 1
        self._pending.append(message)

    def checked(self, message: MessageLike) -> MessageLike:
        """Return the message as a payload, or unchanged while the topic's type is unknown.

        Safe from any thread. Raises what :meth:`publish` raises.
        """
        if self.error is not None:
            raise self.error
        if self._type is None:
            return message
        if self._flow is None:
            raise self._session.not_connected()
        return to_payload(self._message_type, message)

    async def ready(self) -> None:
        """Wait until the type is known and earlier messages were sent; see :class:`Handle`.

        Raises:
            InvalidMessage: an earlier message does not fit the type.
        """
        await super().ready()
        invalid, self._invalid = self._invalid, None
        if invalid is not None:
            raise invalid

    async def drain(self) -> None:
        """Wait until the network has taken all published messages, to publish no faster than it."""
        await self._connection.drained()

    async def confirm(self, *, timeout: Timeout = USUAL) -> None:
        """Wait until the server has processed all messages published before.

        Raises:
            MessageRejected: it rejected one since the last call; with its text about the first.
            ServerRefused: it rejected the advertisement; with its text.
            InvalidMessage: an earlier message does not fit the type.
            CallTimeout: it did not answer in time.
            ConnectionLost: the connection was lost first.
            HandleClosed: this publisher was closed.
        """
        await self.ready()
        patience = self._connection.timeout if timeout is USUAL else timeout
        # Servers process requests in order, and any answer will do: one without rosapi answers with an error.
        with suppress(ServiceFailed, ProviderNotFound):
            await call_service(self._session, "/rosapi/get_time", RawJson(b"{}"), patience)
        rejection, self.rejection = self.rejection, None
        if (error := self.error or rejection) is not None:
            raise error

    def release(self) -> None:
        self._session.remove(self._messages_id)
        self.error = HandleClosed(f"the publisher on {self.name} was closed")

    def withdrawal(self) -> Unadvertise:
        return Unadvertise(topic=self.name, id=self.id)

    def __repr__(self) -> str:
        return f"<Publisher {self.name}>"

    # -- called by the session ------------------------------------------------------------------------------

    def take_type(self, type: MessageType) -> None:
        self._message_type = type
        self._wire_type = self._connection.types.wire_name(type)
        self._session.add(self._messages_id, _Messages(self))

    def opened(self) -> None:
        while self._pending and self._flow is not None:
            try:
                self.publish(self._pending.popleft())
            except InvalidMessage as error:
                self._invalid = self._invalid or error
                logger.warning("a message for %s was not published: %s", self.name, error)

    def restore(self) -> None:
        # Left out of the op where they have their defaults, which other servers may not know.
        given: dict[str, Any] = {name: value for name, value in self._options.items() if value}
        self._session.send(Advertise(topic=self.name, type=self._wire_type, id=self.id, **given))
        self._flow = self._session.flow(self.name, self._on_drop)

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """Reject messages: with `error` if it is final, otherwise until the next connection."""
        self._flow = None
        super().lost(error, final)

    def refused(self, text: str) -> None:
        self.fail(ServerRefused(text))

    def fail(self, error: RobotError) -> None:
        self.error = error

    def message_refused(self, text: str) -> None:
        """Note that the server rejected a message."""
        self.rejected += 1
        self.rejection = self.rejection or MessageRejected(text)
        now = time.monotonic()
        if self._logged[0] != text or now - self._logged[1] > _LOG_SECONDS:
            self._logged = (text, now)
            logger.warning(
                "the server rejected a message for %s: %s (%d so far)", self.name, text, self.rejected
            )
        self._session.events.publish(ConnectionEvent("status", text, level="error"))

    def _on_drop(self, reason: DropReason) -> None:
        self.dropped += 1


class _Messages:
    """Messages of a publisher: the server's rejections of them have an id of their own."""

    def __init__(self, publisher: RemotePublisher) -> None:
        self._publisher = publisher

    def restore(self) -> None:
        """No-op: messages are not repeated on a new connection."""

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """No-op: the publisher handles it."""

    def refused(self, text: str) -> None:
        self._publisher.message_refused(text)
