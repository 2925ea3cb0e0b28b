"""Exceptions of `rwt_protocol`. Sessions do not raise: `Session.decode` returns errors as `Refusal`."""

from __future__ import annotations

from typing import Literal

Level = Literal["info", "warning", "error", "none"]
"""Levels of `set_level` and `status` (STA-01)."""


class ProtocolError(Exception):
    """Base of all exceptions of this package."""


class Refused(ProtocolError):
    """The handler rejects the op. The text is sent to the peer unchanged.

    Attributes:
        reason: the text.
        level: severity of the `status` message that carries it, if one does (STA-04).
    """

    def __init__(self, reason: str, level: Level = "error") -> None:
        super().__init__(reason)
        self.reason = reason
        self.level: Level = level


class MalformedMessage(Refused):
    """A frame holds something that is not a message of the protocol. The text is the one sent on the wire.

    Attributes:
        op: name of the op as sent; empty if unreadable.
        id: id of the sender; None if unreadable.
        name: name of the service or action; empty if unreadable.
    """

    def __init__(self, reason: str, op: str = "", id: str | int | None = None, name: str = "") -> None:
        super().__init__(reason)
        self.op = op
        self.id = id
        self.name = name


class MalformedPayload(Refused):
    """The payload is not one JSON value in UTF-8, or holds a value that the encoding does not support."""


class Misread(ProtocolError):
    """A light op stands for a frame that is something else: read it with `Session.decode_again`.

    Attributes:
        frame: the frame.
    """

    def __init__(self, frame: bytes) -> None:
        super().__init__(f"a frame of {len(frame)} bytes is not the message that its ends show")
        self.frame = frame


class EncodingUnavailable(Refused):
    """The encoding needs a package that is not installed."""


class IncompleteDispatcher(ProtocolError, TypeError):
    """A handler is missing for an op, or exists for an op that does not arrive."""
