"""Errors of robot programs, in the graph and over a connection.

`rwt_graph` and `rwt_client` raise these classes, and each has a few of its own.
"""

from __future__ import annotations

from rwt_interfaces.errors import InterfaceError as InterfaceError
from rwt_interfaces.errors import InvalidMessage as InvalidMessage
from rwt_interfaces.errors import RobotError as RobotError
from rwt_interfaces.errors import UnknownType as UnknownType


class CallFailed(RobotError):
    """The service call or goal ended without an answer from its handler."""


class ServiceFailed(CallFailed):
    """The provider reported failure. A handler raises it to tell the caller the reason."""


class TimedOut(RobotError, TimeoutError):
    """The timeout expired."""


class CallTimeout(CallFailed, TimedOut):
    """No answer arrived in time."""


class ProviderGone(CallFailed):
    """The provider was withdrawn, replaced or disconnected before it answered.

    Attributes:
        node: node that left with its provider; empty if only the provider left, or that is not known.
    """

    node: str = ""


class NotFound(RobotError, LookupError):
    """The topic, service, action, node or parameter does not exist."""


class ProviderNotFound(CallFailed, NotFound):
    """The service or action does not exist."""


class WrongType(CallFailed, ValueError):
    """The service or action has another type than the program states."""


class GoalRejected(CallFailed):
    """The action server did not accept the goal."""


class InvalidQoS(RobotError, ValueError):
    """A policy has a number out of its range; the text names both."""


class ParameterRejected(RobotError, ValueError):
    """The node rejects the parameter's value, or has no such parameter."""


class WrongThread(RobotError, RuntimeError):
    """A blocking call was made on the event loop's own thread; await the coroutine there."""


class HandleClosed(RobotError):
    """This program has closed the publisher or subscription that it uses."""


class TransformUnavailable(RobotError, LookupError):
    """A transform was not available in time; the text names it."""


class ImageFormat(RobotError, ValueError):
    """The image has an unsupported format, or too few bytes."""


class GoalEnded(RobotError):
    """Base of the errors that an action's `execute` raises to end its goal other than by success.

    Attributes:
        result: result of the goal; None for a result of defaults.
        reason: text for people, for the log and for clients if the protocol can carry it.
    """

    def __init__(self, result: object = None, reason: str = "") -> None:
        super().__init__(reason or "the goal ended")
        self.result = result
        self.reason = reason


class GoalCanceled(GoalEnded):
    """End the goal as canceled, as requested."""


class GoalAborted(GoalEnded):
    """End the goal as aborted: it cannot be reached."""
