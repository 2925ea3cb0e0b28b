"""Replies to one client: everything that is sent to it besides samples of its channels."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from rwt.gateways.base import ControlLane
from rwt.gateways.foxglove.wire.server_messages import Level, status
from rwt_transports.endpoint import FlowRules

if TYPE_CHECKING:
    from rwt_protocol.frames import Frame
    from rwt_transports.endpoint import Flow, Sink

_LOG_LEVELS = {Level.INFO: logging.DEBUG, Level.WARNING: logging.INFO, Level.ERROR: logging.WARNING}


class StatusLane(ControlLane):
    """Control lane to one Foxglove client: responses, failures and status lines."""

    __slots__ = ()

    def send(self, frame: Frame) -> None:
        """Send a frame without a size limit."""
        self.sink.send(frame)

    def say(self, level: Level, message: str) -> None:
        """Send the client a status line, and log it."""
        self.log(_LOG_LEVELS[level], message)
        self.sink.send(status(level, message))


class Notice:
    """Warnings about one topic, in a flow of depth one: at most one waits for a client that does not read."""

    __slots__ = ("_flow", "_said", "_sink", "_topic")

    def __init__(self, sink: Sink, topic: str) -> None:
        self._sink = sink
        self._topic = topic
        self._said = ""
        self._flow: Flow | None = None

    def say(self, message: str) -> None:
        """Send a warning, unless it equals the last one."""
        if message == self._said:
            return
        self._said = message
        if self._flow is None:
            self._flow = self._sink.flow(f"status of {self._topic}", FlowRules(depth=1, notes=True))
        self._flow.send(status(Level.WARNING, message, f"dropped {self._topic}"))

    def close(self) -> None:
        """Send no more warnings."""
        if self._flow is not None:
            self._flow.close()
