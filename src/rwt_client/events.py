"""Events of a connection."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rwt_participant.handles import QUEUE_BYTES, MessageQueue

logger = logging.getLogger("rwt_client")

EventKind = Literal["connected", "lost", "retrying", "restored", "status", "closed"]

_MOST_QUEUED = 1000


@dataclass(frozen=True, slots=True)
class ConnectionEvent:
    """Event of the connection.

    Attributes:
        kind: ``connected`` (the first time), ``lost``, ``retrying`` (after `delay` seconds), ``restored``
            (connected again, with all subscriptions and advertisements), ``status`` (status message that
            belongs to no pending request), ``closed`` (for good; nothing follows).
        text: reason, in the words of the server or the system; may be empty.
        attempt: for ``retrying``, number of the next attempt, from 1.
        delay: for ``retrying``, seconds until it.
        level: for ``status``: ``info``, ``warning`` or ``error``.
    """

    kind: EventKind
    text: str = ""
    attempt: int = 0
    delay: float = 0.0
    level: str = ""

    def __str__(self) -> str:
        return f"{self.kind}: {self.text}" if self.text else self.kind


class Events:
    """Listeners of the events of a connection."""

    def __init__(self) -> None:
        self._callbacks: list[Callable[[ConnectionEvent], object]] = []

    def publish(self, event: ConnectionEvent) -> None:
        """Pass `event` to all listeners, at once."""
        for callback in tuple(self._callbacks):
            try:
                callback(event)
            except Exception:
                logger.exception("a callback for connection events failed on %s", event)

    def listen(self, callback: Callable[[ConnectionEvent], object]) -> Callable[[], None]:
        """Call `callback` with each event from now on; returns a function that ends this."""
        self._callbacks.append(callback)

        def end() -> None:
            if callback in self._callbacks:
                self._callbacks.remove(callback)

        return end

    def stream(self) -> EventStream:
        """Return the events from now on, as an async iterator."""
        stream = EventStream()
        self._callbacks.append(stream.put)
        return stream


class EventStream:
    """Async iterator over the events of a connection; ends after ``closed``."""

    def __init__(self) -> None:
        self._events = MessageQueue[ConnectionEvent]("connection events", _MOST_QUEUED, QUEUE_BYTES)
        self._ended = False

    def put(self, event: ConnectionEvent) -> None:
        """Queue an event; drops the oldest if too many are queued."""
        self._events.put(event, 0)

    def __aiter__(self) -> EventStream:
        return self

    async def __anext__(self) -> ConnectionEvent:
        if self._ended:
            raise StopAsyncIteration
        while not self._events:
            await self._events.wait()
        event = self._events.pop()
        self._ended = event.kind == "closed"
        return event
