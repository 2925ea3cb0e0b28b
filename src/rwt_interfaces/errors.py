"""Exceptions of `rwt_interfaces`."""

from __future__ import annotations


class RobotError(Exception):
    """Base of the exceptions of all packages. The text says what failed, where, and what to do."""


class InterfaceError(RobotError):
    """Base of all exceptions of this package."""


class InvalidName(InterfaceError, ValueError):
    """ROS does not allow the type, package or field name."""


class DefinitionError(InterfaceError, ValueError):
    """The definition is invalid; the message names the text and the line."""


class UnknownType(InterfaceError, LookupError):
    """The message, service or action is unknown."""


class InvalidMessage(InterfaceError, ValueError):
    """The message does not fit its type.

    Attributes:
        path: path from the message's root, for example ``pose.covariance[3]``; empty for the root itself.
        reason: expectation and value, for example ``expected float64, got "fast"``.
    """

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f"{path}: {reason}" if path else reason)
        self.path = path
        self.reason = reason


class TooManyValues(InvalidMessage):
    """The text has too many values to be decoded at once, and cannot be split."""


class NotExact(InvalidMessage):
    """The text has too many objects to be parsed, and may not be passed on untouched."""

    def __init__(self) -> None:
        super().__init__("", "not as ROS writes it")
