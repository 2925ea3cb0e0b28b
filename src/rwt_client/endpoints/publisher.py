"""Publishing on topics."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rwt_client.errors import ConnectionClosed, ConnectionLost, ServerRefused
from rwt_program.messages import MessageLike, to_payload
from rwt_protocol.codecs.json import publish_frame, publish_prefix
from rwt_protocol.ops import Advertise, Qos, Unadvertise
from rwt_protocol.transport import DropReason, Flow

if TYPE_CHECKING:
    from rwt_client.wire.session import ReconnectingSession
    from rwt_interfaces.structs import MessageType


@dataclass(frozen=True, slots=True)
class AdvertiseOptions:
    """How a topic is advertised.

    Attributes:
        latch: whether late subscribers get the last message.
        queue_size: messages kept for slow subscribers, where the server speaks ROS 1.
        qos: quality of service, where the server speaks ROS 2.
    """

    latch: bool = False
    queue_size: int | None = None
    qos: Qos | None = None


class Publisher:
    """Publishes on one topic until :meth:`close`; advertised again after a reconnection.

    Attributes:
        name: the topic.
        type: its type.
        sent: messages published so far.
        dropped: those of them that were dropped because the network was too slow.
    """

    def __init__(
        self,
        session: ReconnectingSession,
        name: str,
        message_type: MessageType,
        wire_type: str,
        options: AdvertiseOptions,
        drained: Callable[[], Awaitable[None]],
    ) -> None:
        self.name = name
        self.type = message_type
        self.sent = 0
        self.dropped = 0
        self._session = session
        self._wire_type = wire_type
        self._options = options
        self._drained = drained
        self._id = session.next_id("advertise", name)
        self._prefix = publish_prefix(name)
        self._flow: Flow | None = None
        self._error: Exception | None = None
        session.add(self._id, self)
        if session.connected:
            self.restore()

    def publish(self, message: MessageLike) -> None:
        """Publish one message. Does not wait: where the network is slower, the oldest that wait are dropped.

        Args:
            message: an instance of the type's class, a mapping or a dataclass instance. What a mapping or
                dataclass does not have gets its default; a header without a stamp gets the time now.

        Raises:
            InvalidMessage: it does not fit the type.
            ServerRefused: the server has refused the advertisement; its text.
            NotConnected: there is no connection now.
            ConnectionClosed: this publisher, or the connection, was closed.
        """
        if self._error is not None:
            raise self._error
        if self._flow is None:
            raise self._session.not_connected()
        self._flow.send(publish_frame(self._prefix, to_payload(self.type, message).json()))
        self.sent += 1

    async def drain(self) -> None:
        """Wait until the network has taken everything that was published, to publish no faster than it."""
        await self._drained()

    def close(self) -> None:
        """Withdraw the advertisement; a second call does nothing."""
        if self._error is None or not isinstance(self._error, ConnectionClosed):
            self._error = ConnectionClosed(f"the publisher on {self.name} was closed")
            self._session.remove(self._id)
            self._session.send_if_connected(Unadvertise(topic=self.name, id=self._id))

    def __enter__(self) -> Publisher:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Publisher {self.name} {self.type.name}>"

    # -- what the session says -------------------------------------------------------------------------------

    def restore(self) -> None:
        """Advertise on a new connection."""
        options = self._options
        given: dict[str, Any] = {}
        if options.latch:
            given["latch"] = True
        if options.queue_size is not None:
            given["queue_size"] = options.queue_size
        if options.qos is not None:
            given["qos"] = options.qos
        self._session.send(Advertise(topic=self.name, type=self._wire_type, id=self._id, **given))
        self._flow = self._session.flow(self.name, self._on_drop)

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """A gap, of which :meth:`publish` tells, or the end."""
        self._flow = None
        if final:
            self._error = error

    def refused(self, text: str) -> None:
        """The server does not take it."""
        self._error = ServerRefused(text)

    def _on_drop(self, reason: DropReason) -> None:
        self.dropped += 1
