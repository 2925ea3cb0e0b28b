"""Subscriptions: messages of one topic as an async iterator or through a callback."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final

import anyio

from rwt_client.endpoints.publisher import wire_qos
from rwt_client.endpoints.remote_handle import RemoteHandle
from rwt_client.errors import ConnectionClosed, ConnectionLost, ServerRefused
from rwt_client.wire.arrays import ArrayKind, check_kind, has_big_arrays, is_encoded_everywhere
from rwt_client.wire.decoding import MessageReader, UnparsedMessage
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import HandleClosed, InvalidMessage, RobotError
from rwt_participant.handles import QUEUE_BYTES, MessageQueue, Subscription
from rwt_participant.messages import (
    HELD_SECONDS,
    Message,
    MessageCallback,
    is_coroutine_function,
    warn_of_held_loop,
)
from rwt_participant.qos import QoS
from rwt_protocol.codecs import SELECTABLE, load_encoding
from rwt_protocol.extensions import ExtensionError, extension_names
from rwt_protocol.ops import Qos, Subscribe, Unsubscribe

if TYPE_CHECKING:
    from rwt_client.endpoints.remote_types import RemoteTypes
    from rwt_client.wire.session import ReconnectingSession
    from rwt_transports.background import TaskStarter

logger = logging.getLogger("rwt_client")

COMPRESSIONS: Final = ("auto", *(encoding.name for encoding in SELECTABLE if not encoding.raw))
"""Supported values of `compression`."""


@dataclass(frozen=True, slots=True)
class SubscribeOptions:
    """Options of a subscription.

    Attributes:
        arrays: type of numeric arrays: ``list``, or ``numpy``.
        compression: one of :data:`COMPRESSIONS`, or an entry point in `rwt.codecs`; ``auto`` requests CBOR
            for messages with big arrays if the server supports it.
        throttle: minimum interval between two messages in seconds, kept by the server; 0 for every message.
        queue_size: messages queued for an iterator or a coroutine callback; the oldest are dropped beyond it.
        queue_bytes: the same limit in bytes; the newest message is queued whatever its size.
        fragment_size: maximum length of a message in characters; the server splits longer ones.
        qos: quality of service, on ROS 2 servers.

    Raises:
        ValueError: `arrays` or `compression` has another value.
    """

    arrays: ArrayKind = "list"
    compression: str = "auto"
    throttle: float = 0.0
    queue_size: int = 1000
    queue_bytes: int = QUEUE_BYTES
    fragment_size: int | None = None
    qos: QoS | Qos | None = None

    def __post_init__(self) -> None:
        check_kind(self.arrays)
        if self.compression not in COMPRESSIONS:
            try:
                encoding = load_encoding(self.compression)
            except ExtensionError:
                encoding = None
            if encoding is None or encoding.raw or encoding.exclusive is not None:
                known = ", ".join((*COMPRESSIONS, *extension_names("rwt.codecs")))
                raise ValueError(f"compression: expected one of {known}, got {self.compression!r}")


class TopicSubscriptions:
    """Subscriptions to one topic; satisfies :class:`rwt_client.wire.session.Destination`."""

    __slots__ = ("subscriptions",)

    def __init__(self) -> None:
        self.subscriptions: tuple[RemoteSubscription, ...] = ()

    def deliver(self, arrived: UnparsedMessage, size: int) -> None:
        for subscription in self.subscriptions:
            subscription.take(arrived, size)


class SubscriptionTable:
    """Shared state of all subscriptions of a client.

    Args:
        binary: whether the transport can carry CBOR (TCP-05).
    """

    __slots__ = ("_topics", "cbor_offered", "session", "tasks", "types")

    def __init__(
        self, session: ReconnectingSession, types: RemoteTypes, tasks: TaskStarter, *, binary: bool
    ) -> None:
        self.session = session
        self.types = types
        self.tasks = tasks
        self.cbor_offered = binary
        self._topics: dict[str, TopicSubscriptions] = {}

    def add(self, subscription: RemoteSubscription) -> None:
        """Add a subscription to its topic."""
        topic = self._topics.setdefault(subscription.name, TopicSubscriptions())
        topic.subscriptions = (*topic.subscriptions, subscription)
        self.session.listen(subscription.name, topic)

    def remove(self, subscription: RemoteSubscription) -> None:
        """Remove a subscription."""
        topic = self._topics[subscription.name]
        topic.subscriptions = tuple(each for each in topic.subscriptions if each is not subscription)
        if not topic.subscriptions:
            del self._topics[subscription.name]
            self.session.listen(subscription.name, None)

    def compression(self, wanted: str, message_type: MessageType) -> str:
        """Return the compression to request."""
        if wanted != "auto":
            return wanted
        if not self.cbor_offered or not has_big_arrays(message_type):
            return "none"
        distro = self.types.distro
        encodes_all = distro is not None and distro.encodes_all_cbor
        return "cbor" if encodes_all or is_encoded_everywhere(message_type) else "none"


class RemoteSubscription(RemoteHandle[MessageType], Subscription):
    """Messages of one topic.

    Iterate over it, or give it a callback. It is active until :meth:`close`, the end of its ``async with``,
    or the final end of the connection; it survives reconnections.

    Attributes:
        received: number of received messages.
        received_bytes: size of these on the connection, in bytes.
        invalid: number of messages that did not fit the type; each is logged.
    """

    _reader: MessageReader
    _ends = (HandleClosed, ConnectionClosed)

    def __init__(
        self, table: SubscriptionTable, name: str, options: SubscribeOptions, callback: MessageCallback | None
    ) -> None:
        is_direct = callback is not None and not is_coroutine_function(callback)
        queue = (
            None
            if is_direct
            else MessageQueue[UnparsedMessage](name, options.queue_size, options.queue_bytes)
        )
        RemoteHandle.__init__(self, table.session, "subscribe", name)
        Subscription.__init__(self, queue, has_callback=callback is not None, within=anyio.move_on_after)
        self.received = 0
        self.received_bytes = 0
        self.invalid = 0
        self._table = table
        self._options = options
        self._compression = "none"
        self._callback = callback

    def take_type(self, type: MessageType) -> None:
        self._compression = self._table.compression(self._options.compression, type)
        self._reader = self._table.types.reader(type, self._options.arrays)
        self._table.add(self)
        if self._queue is not None and self._callback is not None:
            self._table.tasks.start_soon(self._call_in_turn, self._queue, self._callback)

    def release(self) -> None:
        self._end(HandleClosed(f"the subscription to {self.name} was closed"))
        if self._type is not None:
            self._table.remove(self)

    def withdrawal(self) -> Unsubscribe:
        return Unsubscribe(topic=self.name, id=self.id)

    def __repr__(self) -> str:
        return f"<Subscription {self.name}>"

    # -- messages --------------------------------------------------------------------------------------------

    def take(self, arrived: UnparsedMessage, size: int) -> None:
        self.received += 1
        self.received_bytes += size
        if self._queue is not None:
            self._queue.put(arrived, size)
            return
        message = self._read(arrived)
        if message is not None:
            self._call_at_once(message)

    def _call_at_once(self, message: Message) -> None:
        assert self._callback is not None  # Only subscriptions with a callback are direct.
        try:
            began = perf_counter()
            self._callback(message)
            if (took := perf_counter() - began) >= HELD_SECONDS:
                warn_of_held_loop(self._callback, f"callback of {self.name}:", took)
        except Exception:
            logger.exception("a subscriber of %s failed", self.name)

    def _read(self, queued: UnparsedMessage) -> Message | None:
        try:
            return self._reader.read(queued)
        except InvalidMessage as error:
            self.invalid += 1
            logger.warning("a message on %s is left out: not %s: %s", self.name, self.type.name, error)
            return None

    # -- called by the session ------------------------------------------------------------------------------

    def restore(self) -> None:
        options = self._options
        given: dict[str, Any] = {}
        if options.throttle > 0:
            given["throttle_rate"] = round(options.throttle * 1000)
        if self._compression != "none":
            given["compression"] = self._compression
        if options.fragment_size:
            given["fragment_size"] = options.fragment_size
        if options.qos is not None:
            given["qos"] = wire_qos(options.qos)
        wire_type = self._table.types.wire_name(self.type.name)
        self._session.send(Subscribe(topic=self.name, type=wire_type, id=self.id, **given))

    def refused(self, text: str) -> None:
        """Subscribe in JSON if the server rejects CBOR; fail if it rejects that, too."""
        if self._compression == "cbor" and self._options.compression == "auto":
            self._table.cbor_offered = False
            self._compression = "none"
            self.restore()
        else:
            self.fail(ServerRefused(text))

    def fail(self, error: RobotError) -> None:
        if self._callback is not None and not isinstance(error, ConnectionLost):
            logger.warning("the subscription to %s was refused: %s", self.name, error)
        self._end(error)
