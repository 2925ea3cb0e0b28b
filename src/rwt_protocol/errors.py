"""Everything that `rwt_protocol` raises.

* :exc:`ProtocolError`

  * :exc:`Refused`: a message is well formed and is not done; handlers raise it.

    * :exc:`MalformedMessage`: a frame that :func:`rwt_protocol.parse` cannot read.
    * :exc:`MalformedPayload`: the bytes of a payload are not one JSON value.
    * :exc:`EncodingUnavailable`: an encoding needs a package that is not installed.

  * :exc:`IncompleteDispatcher`: the table of handlers and the table of ops disagree.

A session raises nothing: :meth:`rwt_protocol.session.Session.decode` returns what is wrong as a `Refusal`.
"""

from __future__ import annotations

from typing import Literal

Level = Literal["info", "warning", "error", "none"]
"""The levels of `set_level` and `status` (STA-01)."""


class ProtocolError(Exception):
    """Base of every error of this package. The text says what, where and what instead."""


class Refused(ProtocolError):
    """A handler will not do what the op asks. The text goes to the peer as it is.

    Attributes:
        reason: the text.
        level: the severity of the `status` message that carries it, where one does (STA-04).
    """

    def __init__(self, reason: str, level: Level = "error") -> None:
        super().__init__(reason)
        self.reason = reason
        self.level: Level = level


class MalformedMessage(Refused):
    """A frame holds something that is not a message of the protocol. The text is what the wire would say.

    Attributes:
        op: the name of the op as it was sent, empty when none could be read.
        id: the sender's id, None when none could be read.
        name: the service or action that was meant, empty when none could be read.
    """

    def __init__(self, reason: str, op: str = "", id: str | int | None = None, name: str = "") -> None:
        super().__init__(reason)
        self.op = op
        self.id = id
        self.name = name


class MalformedPayload(Refused):
    """The bytes of a payload are not one JSON value in UTF-8, or its value is none that an encoding has."""


class EncodingUnavailable(Refused):
    """An encoding needs a package that is not installed."""


class IncompleteDispatcher(ProtocolError, TypeError):
    """A handler is missing for an op, or is there for something that no peer may send."""
