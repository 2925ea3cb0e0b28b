"""Errors of robot programs, in the graph and over a connection.

`rwt_graph` and `rwt_client` raise these classes, and each has a few of its own.

* :exc:`RobotError`

  * :exc:`CallFailed`: a service call or goal that ended without an answer from its handler.

    * :exc:`ServiceFailed`: the provider answered that it failed; raised *by* a service's handler, too.
    * :exc:`CallTimeout`: there was no answer in time; also a :exc:`TimedOut`.
    * :exc:`ProviderGone`: the provider left first.
    * :exc:`ProviderNotFound`: the service or action does not exist; also a :exc:`NotFound`.
    * :exc:`GoalRejected`: the action server did not accept the goal.

  * :exc:`NotFound`: no such topic, service, action, node or parameter; also a :exc:`LookupError`.
  * :exc:`InvalidQoS`: a policy with a number out of its range; also a :exc:`ValueError`.
  * :exc:`ParameterRejected`: a parameter cannot have that value; also a :exc:`ValueError`.
  * :exc:`TimedOut`: the timeout expired; also a :exc:`TimeoutError`.
  * :exc:`WrongThread`: a blocking call on the event loop's own thread, which would wait for itself.
  * :exc:`HandleClosed`: this program has closed the publisher or subscription that it uses.
  * :exc:`TransformUnavailable`: a transform is not available; also a :exc:`LookupError`.
  * :exc:`ImageFormat`: an image that cannot be converted; also a :exc:`ValueError`.
  * :exc:`GoalEnded`: raised *by* an action's `execute`, to end its goal otherwise than by success.

    * :exc:`GoalCanceled`: as canceled.
    * :exc:`GoalAborted`: as aborted.

  * :exc:`InterfaceError`: of types and messages; see :mod:`rwt_interfaces.errors`.

    * :exc:`InvalidMessage`: a message that does not fit its type; also a :exc:`ValueError`.
    * :exc:`UnknownType`: no such message, service or action type is known; also a :exc:`LookupError`.
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
    """The provider was withdrawn, replaced or disconnected before it answered."""


class NotFound(RobotError, LookupError):
    """The topic, service, action, node or parameter does not exist."""


class ProviderNotFound(CallFailed, NotFound):
    """The service or action does not exist."""


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
