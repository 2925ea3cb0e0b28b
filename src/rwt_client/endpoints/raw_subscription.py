"""Subscriptions without decoding: serialised messages with the server's stamps."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from rwt_client.endpoints.remote_handle import RemoteHandle
from rwt_client.errors import ServerRefused
from rwt_interfaces.structs import MessageType
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.errors import InvalidMessage, RobotError
from rwt_participant.messages import RawCallback, RawMessage
from rwt_protocol.ops import Qos, Subscribe, Unsubscribe

if TYPE_CHECKING:
    from rwt_client.endpoints.subscriptions import SubscriptionTable
    from rwt_client.wire.decoding import MessageReader, UnparsedMessage
    from rwt_participant.messages import Message

logger = logging.getLogger("rwt_client")

_EVERYTHING = Qos(history="keep_all", reliability="best_available")
"""QoS for programs that keep or pass on all messages; by default a slow reader gets only the newest."""

_MEMBERS = frozenset(("secs", "nsecs", "bytes"))


class RawSubscription(RemoteHandle[MessageType]):
    """Serialised messages of one topic (`cbor-raw`, CBR-10 to CBR-12).

    If the server does not support this, messages arrive as JSON and are serialised here, without a stamp. The
    subscription survives reconnections. The same client cannot subscribe to the topic in another way as well:
    a server sends a topic to a client in one encoding.

    Attributes:
        received: number of received messages.
        invalid: number of unreadable messages; each is logged.
        error: error that ended the subscription; None while it is active.
    """

    _reader: MessageReader
    _serialise: Callable[[Message], bytes]

    def __init__(self, table: SubscriptionTable, name: str, callback: RawCallback) -> None:
        super().__init__(table.session, "subscribe", name)
        self.received = 0
        self.invalid = 0
        self.error: RobotError | None = None
        self._callback = callback
        self._types = table.types
        self._compression: Literal["cbor-raw", "none"] = "cbor-raw" if table.cbor_offered else "none"

    def take_type(self, type: MessageType) -> None:
        self._reader = self._types.reader(type)
        self._serialise = type.serialise
        self._session.listen(self.name, self)
        self._session.raw_topics += 1

    def release(self) -> None:
        if self._type is not None:
            self._session.raw_topics -= 1
            self._session.listen(self.name, None)

    def withdrawal(self) -> Unsubscribe:
        return Unsubscribe(topic=self.name, id=self.id)

    def deliver(self, arrived: UnparsedMessage, size: int) -> None:
        self.received += 1
        try:
            self._callback(self._raw(arrived))
        except InvalidMessage as error:
            self.invalid += 1
            logger.warning("a message on %s is left out: not %s: %s", self.name, self.type.name, error)
        except Exception:
            logger.exception("a subscriber of %s failed", self.name)

    def _raw(self, arrived: UnparsedMessage) -> RawMessage:
        if isinstance(arrived, dict) and arrived.keys() == _MEMBERS:
            seconds, nanoseconds, data = arrived["secs"], arrived["nsecs"], arrived["bytes"]
            if (
                isinstance(seconds, int)
                and isinstance(nanoseconds, int)
                and isinstance(data, memoryview | bytes)
            ):
                return RawMessage(data, seconds * NANOSECONDS + nanoseconds, self.type)
        return RawMessage(self._serialise(self._reader.read(arrived)), None, self.type)

    # -- called by the session ------------------------------------------------------------------------------

    def restore(self) -> None:
        self._session.send(
            Subscribe(
                topic=self.name,
                type=self._types.wire_name(self.type.name),
                id=self.id,
                compression=self._compression,
                qos=_EVERYTHING,
            )
        )

    def refused(self, text: str) -> None:
        """Subscribe in JSON if the server rejects `cbor-raw`; fail if it rejects that, too."""
        if self._compression == "cbor-raw":
            self._compression = "none"
            self.restore()
        else:
            self.fail(ServerRefused(text))
            logger.warning("the subscription to %s was refused: %s", self.name, text)

    def fail(self, error: RobotError) -> None:
        self.error = error
