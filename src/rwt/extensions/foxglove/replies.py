"""Replies to one client: everything sent to it besides samples of its channels."""

from __future__ import annotations

import logging

from rwt.extensions.foxglove.wire.server_messages import Level, status
from rwt.gateways.base import ReplySender
from rwt_protocol.frames import Frame

_LOG_LEVELS = {Level.INFO: logging.DEBUG, Level.WARNING: logging.INFO, Level.ERROR: logging.WARNING}


class FoxgloveReplies(ReplySender):
    """Sender of responses, failures and status lines to one Foxglove client."""

    __slots__ = ()

    def send(self, frame: Frame) -> None:
        """Send a frame without a size limit."""
        self.sink.send(frame)

    def say(self, level: Level, message: str) -> None:
        """Send the client a status line, and log it."""
        self.log(_LOG_LEVELS[level], message)
        self.sink.send(status(level, message))
