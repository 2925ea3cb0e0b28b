"""Everything that `rwt_interfaces` raises.

* :exc:`InterfaceError`

  * :exc:`InvalidName`: not a name that ROS allows.
  * :exc:`DefinitionError`: a ``.msg``, ``.srv`` or ``.action`` text that cannot be read.
  * :exc:`UnknownType`: no such message, service or action is known.
  * :exc:`InvalidMessage`: a message that does not fit its type.

    * :exc:`TooManyValues`: one that may fit, and is too large to find out at once.
    * :exc:`NotExact`: one that may fit, and has to be passed on untouched, which it cannot.
"""

from __future__ import annotations


class RobotError(Exception):
    """Base of what programs meet in any package: the text says what, where and what instead."""


class InterfaceError(RobotError):
    """Base of every error of this package."""


class InvalidName(InterfaceError, ValueError):
    """A type, package or field name that ROS does not allow."""


class DefinitionError(InterfaceError, ValueError):
    """A definition that cannot be read; the message says in which text and on which line."""


class UnknownType(InterfaceError, LookupError):
    """No message, service or action of that name is known."""


class InvalidMessage(InterfaceError, ValueError):
    """A message that does not fit its type.

    Attributes:
        path: where, from the message's root, for example ``pose.covariance[3]``; empty for the root itself.
        reason: what was expected and what came, for example ``expected float64, got "fast"``.
    """

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f"{path}: {reason}" if path else reason)
        self.path = path
        self.reason = reason


class TooManyValues(InvalidMessage):
    """A text with too many values to be decoded at once, which cannot be split either."""


class NotExact(InvalidMessage):
    """A text with too many objects to be parsed, which may not be passed on untouched."""

    def __init__(self) -> None:
        super().__init__("", "not as ROS writes it")
