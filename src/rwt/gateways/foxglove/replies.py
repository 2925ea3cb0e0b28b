"""How one client is told what is not a message of a channel: answers, failures and status lines."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from rwt.access.audit import LineRate, is_written, one_line
from rwt.gateways.foxglove.wire.server_messages import Level, status
from rwt_transports.endpoint import FlowRules

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.audit import Audit
    from rwt_protocol.frames import Frame
    from rwt_transports.endpoint import Flow, Sink

_LOG_LEVELS = {Level.INFO: logging.DEBUG, Level.WARNING: logging.INFO, Level.ERROR: logging.WARNING}


class Replies:
    """The control lane to one client, and the log about it.

    Attributes:
        sink: its connection.

    Args:
        number: the client's.
        sink: see above.
        most: bytes of the largest message that it is sent.
        audit: the log.
        monotonic: seconds on a clock that never goes back.
    """

    __slots__ = ("_audit", "_line_rate", "_monotonic", "_most", "_number", "sink")

    def __init__(
        self, number: int, sink: Sink, most: int, audit: Audit, monotonic: Callable[[], float]
    ) -> None:
        self.sink = sink
        self._number = number
        self._most = most
        self._audit = audit
        self._line_rate = LineRate(per_second=1, burst=50)
        self._monotonic = monotonic

    def send(self, frame: Frame) -> None:
        """Send what has no bound of its own."""
        self.sink.send(frame)

    def too_large(self, size: int) -> str:
        """Why a message of `size` bytes may not be sent; empty if it may."""
        if size <= self._most:
            return ""
        return f"a message of {size} bytes, and {self._most} is the limit (limits.outgoing_message_bytes)"

    def say(self, level: Level, message: str) -> None:
        """Tell the client something that a person should know, and note it."""
        self.log(_LOG_LEVELS[level], message)
        self.sink.send(status(level, message))

    def log(self, level: int, text: str) -> None:
        """One line in the log, with the client's number."""
        if not is_written(level):
            return
        line = self._line_rate.admit(one_line(text), self._monotonic())
        if line is not None:
            self._audit.write(level, "[foxglove client %d] %s", self._number, line, client=self._number)


class Notice:
    """Warnings about one topic, in a flow of depth one: a client that reads nothing is owed one of them.

    What has been said is not said again, since viewers list each text that they are told.
    """

    __slots__ = ("_flow", "_said", "_sink", "_topic")

    def __init__(self, sink: Sink, topic: str) -> None:
        self._sink = sink
        self._topic = topic
        self._said = ""
        self._flow: Flow | None = None

    def say(self, message: str) -> None:
        """Warn, unless it was the last thing that was said."""
        if message == self._said:
            return
        self._said = message
        if self._flow is None:
            self._flow = self._sink.flow(f"status of {self._topic}", FlowRules(depth=1, notes=True))
        self._flow.send(status(Level.WARNING, message, f"dropped {self._topic}"))

    def close(self) -> None:
        """Say nothing more."""
        if self._flow is not None:
            self._flow.close()
