"""Subscriptions: messages of one topic as an async iterator or through a callback."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any, Final, TypedDict, Unpack

import anyio

from rwt_client.endpoints.publisher import wire_qos
from rwt_client.endpoints.remote_handle import ClientConnection, RemoteHandle
from rwt_client.errors import ConnectionClosed, ConnectionLost, ServerRefused
from rwt_client.wire.arrays import ArrayKind, check_kind, has_big_arrays, is_encoded_everywhere
from rwt_client.wire.clouds import CloudReader
from rwt_client.wire.decoding import UnparsedMessage
from rwt_interfaces.point_clouds.wish import CLOUD, COMPRESSED
from rwt_interfaces.structs import MessageType
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.errors import HandleClosed, InvalidMessage, RobotError
from rwt_participant.handles import QUEUE_BYTES, Subscription
from rwt_participant.messages import (
    HELD_SECONDS,
    Message,
    MessageCallback,
    RawCallback,
    RawMessage,
    warn_of_held_loop,
)
from rwt_participant.qos import QoS
from rwt_protocol.codecs import SELECTABLE, load_encoding
from rwt_protocol.extensions import ExtensionError, extension_names
from rwt_protocol.ops import Qos, Subscribe, Unsubscribe
from rwt_protocol.ops.topics import Compact

logger = logging.getLogger("rwt_client")

COMPRESSIONS: Final = ("auto", *(encoding.name for encoding in SELECTABLE if not encoding.raw))
"""Supported values of `compression`."""


class SubscribeOptions(TypedDict, total=False):
    """Options of a subscription.

    Attributes:
        arrays: type of numeric arrays: ``list``, or ``numpy``.
        compression: one of :data:`COMPRESSIONS`, or an entry point in `rwt.codecs`; ``auto`` requests CBOR
            for messages with big arrays if the server supports it.
        throttle: minimum interval between two messages in seconds, kept by the server; 0 for every message.
        queue_size: messages queued for an iterator or a coroutine callback; the oldest are dropped beyond it.
            1000 by default.
        queue_bytes: the same limit in bytes; the newest message is queued whatever its size.
        fragment_size: maximum length of a message in characters; the server splits longer ones.
        qos: quality of service, on ROS 2 servers.
        compact: request for a smaller form of point clouds, which are decompressed here; servers without it
            send whole clouds. Needs the extra `clouds`.
    """

    arrays: ArrayKind
    compression: str
    throttle: float
    queue_size: int
    queue_bytes: int
    fragment_size: int | None
    qos: QoS | Qos | None
    compact: Compact | Mapping[str, object] | None


def _check_compression(name: str) -> None:
    if name in COMPRESSIONS:
        return
    try:
        encoding = load_encoding(name)
    except ExtensionError:
        encoding = None
    if encoding is None or encoding.raw or encoding.exclusive is not None:
        known = ", ".join((*COMPRESSIONS, *extension_names("rwt.codecs")))
        raise ValueError(f"compression: expected one of {known}, got {name!r}")


def _compact_of(wish: Compact | Mapping[str, object] | None) -> Compact | None:
    if wish is None or isinstance(wish, Compact):
        return wish
    unknown = wish.keys() - Compact.model_fields.keys()
    if unknown:
        raise ValueError(f"compact: expected {', '.join(Compact.model_fields)}, got {min(unknown)!r}")
    return Compact.model_validate(wish)


class RemoteSubscription(RemoteHandle[MessageType], Subscription):
    """Messages of one topic.

    Iterate over it, or give it a callback. It is active until :meth:`close`, the end of its ``async with``,
    or the final end of the connection; it survives reconnections.

    Attributes:
        received: number of received messages.
        received_bytes: size of these on the connection, in bytes.
        invalid: number of messages that did not fit the type; each is logged.

    Raises:
        ValueError: the option `arrays`, `compression` or `compact` has another value.
    """

    _decode: Callable[[UnparsedMessage], Message]
    _ends = (HandleClosed, ConnectionClosed)

    def __init__(
        self,
        connection: ClientConnection,
        name: str,
        callback: MessageCallback | None,
        **options: Unpack[SubscribeOptions],
    ) -> None:
        self._arrays = options.get("arrays", "list")
        self._asked = options.get("compression", "auto")
        check_kind(self._arrays)
        _check_compression(self._asked)
        self._compact = _compact_of(options.get("compact"))
        limits = options.get("queue_size", 1000), options.get("queue_bytes", QUEUE_BYTES)
        RemoteHandle.__init__(self, connection, "subscribe", name)
        Subscription.__init__(self, name, callback, *limits, anyio.move_on_after)
        self.received = 0
        self.received_bytes = 0
        self.invalid = 0
        self._options = options
        self._compression = "none"

    def take_type(self, type: MessageType) -> None:
        self._compression = self._asked if self._asked != "auto" else self._best_compression(type)
        self._decode = self._reader(type)
        self._session.listen(self.name, self.deliver)
        if self._queue is not None and self._callback is not None:
            self._connection.tasks.start_soon(self._call_in_turn, self._queue, self._callback)

    def _reader(self, type: MessageType) -> Callable[[UnparsedMessage], Message]:
        types = self._connection.types
        whole = types.reader(type, self._arrays)
        compact = types.known_message(COMPRESSED) if self._compact and type.name == CLOUD else None
        return whole.read if compact is None else CloudReader(whole, types.reader(compact)).read

    def _best_compression(self, type: MessageType) -> str:
        if not self._connection.cbor_offered or not has_big_arrays(type):
            return "none"
        distro = self._connection.types.distro
        encodes_all = distro is not None and distro.encodes_all_cbor
        return "cbor" if encodes_all or is_encoded_everywhere(type) else "none"

    def release(self) -> None:
        self._end(HandleClosed(f"the subscription to {self.name} was closed"))
        if self._type is not None:
            self._session.ignore(self.name, self.deliver)

    def withdrawal(self) -> Unsubscribe:
        return Unsubscribe(topic=self.name, id=self.id)

    @property
    def error(self) -> RobotError | None:
        """Error that ended the subscription; None while it is active."""
        return self._error

    def __repr__(self) -> str:
        return f"<Subscription {self.name}>"

    # -- messages --------------------------------------------------------------------------------------------

    def deliver(self, arrived: UnparsedMessage, size: int) -> None:
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
            return self._decode(queued)
        except InvalidMessage as error:
            self.invalid += 1
            logger.warning("a message on %s is left out: not %s: %s", self.name, self.type.name, error)
            return None

    # -- called by the session ------------------------------------------------------------------------------

    def restore(self) -> None:
        options = self._options
        given: dict[str, Any] = {}
        if (throttle := options.get("throttle", 0.0)) > 0:
            given["throttle_rate"] = round(throttle * 1000)
        if self._compression != "none":
            given["compression"] = self._compression
        if fragment_size := options.get("fragment_size"):
            given["fragment_size"] = fragment_size
        if (qos := options.get("qos")) is not None:
            given["qos"] = wire_qos(qos)
        if self._compact is not None:
            given["compact"] = self._compact
        wire_type = self._connection.types.wire_name(self.type)
        self._session.send(Subscribe(topic=self.name, type=wire_type, id=self.id, **given))

    def refused(self, text: str) -> None:
        """Subscribe in JSON if the server rejects CBOR; fail if it rejects that, too."""
        if self._compression == "cbor" and self._asked == "auto":
            self._connection.cbor_offered = False
            self._compression = "none"
            self.restore()
        else:
            self.fail(ServerRefused(text))

    def fail(self, error: RobotError) -> None:
        if self._callback is not None and not isinstance(error, ConnectionLost):
            logger.warning("the subscription to %s was refused: %s", self.name, error)
        self._end(error)


_EVERYTHING = Qos(history="keep_all", reliability="best_available")
"""QoS for programs that keep or pass on all messages; by default a slow reader gets only the newest."""

_MEMBERS = frozenset(("secs", "nsecs", "bytes"))


class RawSubscription(RemoteSubscription):
    """Serialised messages of one topic (`cbor-raw`, CBR-10 to CBR-12), with the server's stamps.

    If the server does not support this, messages arrive as JSON and are serialised here, without a stamp. The
    same client cannot subscribe to the topic in another way as well: a server sends a topic to a client in
    one encoding.
    """

    _decode_plain: Callable[[UnparsedMessage], Message]

    def __init__(self, connection: ClientConnection, name: str, callback: RawCallback) -> None:
        super().__init__(connection, name, callback, qos=_EVERYTHING)

    def take_type(self, type: MessageType) -> None:
        super().take_type(type)
        self._decode_plain, self._decode = self._decode, self._decode_raw
        self._session.raw_topics += 1

    def _best_compression(self, type: MessageType) -> str:
        return "cbor-raw" if self._connection.cbor_offered else "none"

    def release(self) -> None:
        super().release()
        if self._type is not None:
            self._session.raw_topics -= 1

    def _decode_raw(self, arrived: UnparsedMessage) -> RawMessage:
        if isinstance(arrived, dict) and arrived.keys() == _MEMBERS:
            seconds, nanoseconds, data = arrived["secs"], arrived["nsecs"], arrived["bytes"]
            if (
                isinstance(seconds, int)
                and isinstance(nanoseconds, int)
                and isinstance(data, memoryview | bytes)
            ):
                return RawMessage(data, seconds * NANOSECONDS + nanoseconds, self.type)
        return RawMessage(self.type.serialise(self._decode_plain(arrived)), None, self.type)

    def refused(self, text: str) -> None:
        """Subscribe in JSON if the server rejects `cbor-raw`; fail if it rejects that, too."""
        if self._compression == "cbor-raw":
            self._compression = "none"
            self.restore()
        else:
            super().refused(text)
