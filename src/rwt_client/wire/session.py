"""Session with the server, which survives reconnections.

Subscriptions, publishers, calls, goals and servers are restorable: they send through the session, are
notified when a connection is lost, and are requested again on a new one. Everything here is synchronous and
runs on the event loop's thread.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable
from typing import Final, Literal, Protocol, Self

import anyio

from rwt_client.errors import ConnectionClosed, ConnectionLost, NotConnected
from rwt_client.events import ConnectionEvent, Events
from rwt_client.wire.cbor import Unreadable, read_cbor, read_raw
from rwt_client.wire.decoding import REJECTIONS, UnparsedMessage, read_envelope
from rwt_protocol.codecs import ENCODINGS
from rwt_protocol.dispatcher import Dispatcher
from rwt_protocol.errors import Level
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Direction, Op, Publish, SetLevel, Status
from rwt_protocol.payloads import RawJson
from rwt_protocol.profiles import COMPAT
from rwt_protocol.session import Refusal, Session
from rwt_transports.endpoint import DropReason, Flow, PeerInfo, Sink

logger = logging.getLogger("rwt_client")

SMALL_BYTES: Final = 256
"""JSON frames below this many bytes are parsed twice, which is faster than searching for the payload."""

LARGE_BYTES: Final = 32 * 1024
"""JSON frames above this many bytes are read by the session, without inspecting the payload."""

_CLOSING_BRACE: Final = ord("}")

_MAPS: Final = frozenset(ENCODINGS["cbor"].first_bytes)


class Restorable(Protocol):
    """Endpoint or request that survives a connection."""

    def restore(self) -> None:
        """Request it again on a new connection."""

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """Handle the loss of the connection; `final`: there will not be another. Never raises."""

    def refused(self, text: str) -> None:
        """Handle the server's rejection of what was sent under its id. Never raises."""


Deliver = Callable[[UnparsedMessage, int], None]
"""Receives one message of a topic, and its size in bytes."""

_match_head: Final = re.compile(rb'\{"op": ?"publish", ?"topic": ?"([^"\\]*)", ?"msg": ?').match
"""Beginning of a published message. The rest up to the last brace is the message, if it is one JSON value:
see :data:`rwt_client.wire.decoding.SplitFrame`."""


class ReconnectingSession:
    """Session of one client, over any number of connections.

    Args:
        level: minimum severity of status messages from the server; None does not request any.

    Attributes:
        dispatcher: handlers of all ops but published messages.
        raw_topics: number of topics subscribed to in `cbor-raw`.
    """

    def __init__(self, level: Level | None, limits: WireLimits) -> None:
        self._level = level
        self._limits = limits
        self._session = Session(COMPAT, Direction.TO_CLIENT, limits)
        self._sink: Sink | None = None
        self._closed: ConnectionLost | None = None
        self._ended = anyio.Event()
        self._restorables: dict[str, Restorable] = {}
        self._count = 0
        self._connect_count = 0
        self.events = Events()
        # Keyed by the bytes of the topic's name, as in frames.
        self._destinations: dict[bytes, tuple[Deliver, ...]] = {}
        self.dispatcher: Dispatcher[None] | None = None
        self.raw_topics = 0

    # -- for restorables -------------------------------------------------------------------------------------

    @property
    def connected(self) -> bool:
        return self._sink is not None

    @property
    def backlog(self) -> int:
        """Number of bytes queued for the network."""
        return 0 if self._sink is None else self._sink.backlog

    def next_id(self, kind: str, name: str) -> str:
        """Return an id that is unique for this client."""
        self._count += 1
        return f"{kind}:{name}:{self._count}"

    def add(self, id: str, restorable: Restorable) -> None:  # as on the wire
        """Restore `restorable` on each new connection, and notify it of status messages for `id`.

        Raises:
            ConnectionClosed: this program has closed the connection.
            ConnectionLost: there will be no connection any more.
        """
        if self._closed is not None:
            raise self._closed
        self._restorables[id] = restorable

    def listen(self, name: str, deliver: Deliver) -> None:
        """Pass the messages of a topic, by its name on the wire, to `deliver`."""
        topic = name.encode()
        self._destinations[topic] = (*self._destinations.get(topic, ()), deliver)

    def ignore(self, name: str, deliver: Deliver) -> None:
        """Pass no further messages of a topic to `deliver`."""
        topic = name.encode()
        left = tuple(each for each in self._destinations.pop(topic) if each != deliver)
        if left:
            self._destinations[topic] = left

    def find(self, id: object) -> Restorable | None:  # as on the wire
        """Return the restorable of that id; None if there is none."""
        return self._restorables.get(id) if isinstance(id, str) else None

    def remove(self, id: str) -> None:  # as on the wire
        self._restorables.pop(id, None)

    def send(self, op: Op) -> None:
        """Send one op.

        Raises:
            NotConnected: there is no connection now.
        """
        self._known_sink().send(self._session.encode(op))

    def flow(self, topic: str, on_drop: Callable[[DropReason], None]) -> Flow:
        """Return a flow for published messages on the current connection.

        Raises:
            NotConnected: there is no connection now.
        """
        return self._known_sink().flow(topic, on_drop=on_drop)

    def not_connected(self) -> ConnectionLost:
        """Return the reason that nothing can be sent."""
        return self._closed or NotConnected("there is no connection to the server now; it is being retried")

    def _known_sink(self) -> Sink:
        if self._sink is None:
            raise self.not_connected()
        return self._sink

    def send_if_connected(self, op: Op) -> None:
        """Send one op that is obsolete when the connection ends, such as an unsubscription."""
        if self._sink is not None:
            self._sink.send(self._session.encode(op))

    # -- for the connection ----------------------------------------------------------------------------------

    def accept(self, sink: Sink, peer: PeerInfo) -> Self:
        """Use a new connection; restorables are requested before anything else is sent."""
        self._sink = sink
        self._session = Session(COMPAT, Direction.TO_CLIENT, self._limits)
        self._ended = anyio.Event()
        self._connect_count += 1
        if self._level is not None:
            self.send(SetLevel(level=self._level))
        # Before programs learn of the connection: what they send then follows its advertisement.
        for restorable in tuple(self._restorables.values()):
            restorable.restore()
        kind: Literal["connected", "restored"] = "connected" if self._connect_count == 1 else "restored"
        self.events.publish(ConnectionEvent(kind))
        return self

    async def ended(self) -> None:
        await self._ended.wait()

    def closed(self, code: int, reason: str) -> None:
        """Note that the connection is lost, and notify restorables."""
        if self._sink is None:
            return
        self._sink = None
        text = reason or f"closed with code {code}"
        self._notify_all(ConnectionLost(f"the connection to the server was lost: {text}"), final=False)
        if self._closed is None:
            self.events.publish(ConnectionEvent("lost", text))
        self._ended.set()

    def close(self, error: ConnectionLost) -> None:
        """Accept no more connections, because of `error`."""
        if self._closed is None:
            self._closed = error
            self._notify_all(error, final=True)
            self._restorables.clear()
            text = "" if isinstance(error, ConnectionClosed) else str(error)
            self.events.publish(ConnectionEvent("closed", text))

    def _notify_all(self, error: ConnectionLost, *, final: bool) -> None:
        for restorable in tuple(self._restorables.values()):
            restorable.lost(error, final)

    # -- receiving -------------------------------------------------------------------------------------------

    def receive(self, data: bytes, binary: bool) -> None:
        size = len(data)
        if SMALL_BYTES < size <= LARGE_BYTES:
            head = _match_head(data)
            if head is not None and data[-1] == _CLOSING_BRACE:
                destinations = self._destinations.get(head[1])
                if destinations is not None:
                    message = (data[head.end() : -1], data)
                    for deliver in destinations:
                        deliver(message, size)
                    return
        if binary and data[:1] and data[0] in _MAPS:
            if self.raw_topics and self._receive_raw(data):
                return
            if self._receive_cbor(data):
                return
        if size <= LARGE_BYTES and self._receive_small(data):
            return
        for op in self._session.decode(data, binary, time.monotonic()):
            self._take(op)

    def _receive_small(self, data: bytes) -> bool:
        """Handle a published message in a small frame; False if it is anything else, or invalid."""
        try:
            found = read_envelope(data)
        except REJECTIONS:
            # Possibly another op with a member of that name; the full parser decides.
            return False
        if found.op != "publish" or not found.msg:
            return False
        self._deliver(found.topic, RawJson(bytes(found.msg)), len(data))
        return True

    def _receive_raw(self, data: bytes) -> bool:
        """Handle a serialised message in CBOR; False if it is anything else."""
        found = read_raw(data)
        if found is None:
            return False
        destinations = self._destinations.get(found[0], ())
        for deliver in destinations:
            deliver(found[1], len(data))
        return bool(destinations)

    def _receive_cbor(self, data: bytes) -> bool:
        """Handle a published message in CBOR; False if it is anything else."""
        try:
            found = read_cbor(data)
        except Unreadable:
            return False
        if not isinstance(found, dict) or found.get("op") != "publish":
            return False
        message, topic = found.get("msg"), found.get("topic")
        if isinstance(topic, str) and isinstance(message, dict):
            self._deliver(topic, message, len(data))
        return True

    def _deliver(self, topic: str, message: UnparsedMessage, size: int) -> None:
        for deliver in self._destinations.get(topic.encode(), ()):
            deliver(message, size)

    def _take(self, op: Op | Refusal) -> None:
        if isinstance(op, Refusal):
            logger.warning("the server sent something that is not understood: %s", op.reason)
            if op.answer is not None:
                self.send_if_connected(op.answer)
        elif isinstance(op, Publish):
            self._deliver(op.topic, op.msg, op.msg.size)
        elif isinstance(op, Status):
            self._take_status(op)
        elif self.dispatcher is not None:
            answer = self.dispatcher.dispatch(None, op)
            if isinstance(answer, Status):
                logger.warning("%s", answer.msg)
            elif answer is not None:
                self.send_if_connected(answer)

    def _take_status(self, op: Status) -> None:
        """Pass a status message to the restorable that it is about, otherwise to the events (STA-03)."""
        restorable = self.find(op.id)
        if restorable is not None and op.level == "error":
            restorable.refused(op.msg)
            return
        logger.warning("the server says (%s): %s", op.level, op.msg)
        self.events.publish(ConnectionEvent("status", op.msg, level=op.level))
