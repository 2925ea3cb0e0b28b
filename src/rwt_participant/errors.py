"""What a program meets when the robot does not do what it was asked, in the graph or over a connection.

`rwt_graph` and `rwt_client` raise these same classes, and each has a few of its own besides.

* :exc:`RobotError`

  * :exc:`CallFailed`: a service call or goal that ended without an answer from its handler.

    * :exc:`ServiceFailed`: the provider answered that it failed; raised *by* a service's handler, too.
    * :exc:`CallTimeout`: no answer in time; also a :exc:`TimedOut`.
    * :exc:`ProviderGone`: the provider went away first.
    * :exc:`ProviderNotFound`: nobody offers that service or action; also a :exc:`NotFound`.
    * :exc:`GoalRejected`: the action server did not accept the goal.

  * :exc:`NotFound`: no such topic, service, action, node or parameter; also a :exc:`LookupError`.
  * :exc:`InvalidQoS`: a policy with a number out of its range; also a :exc:`ValueError`.
  * :exc:`ParameterRejected`: a parameter cannot have that value; also a :exc:`ValueError`.
  * :exc:`TimedOut`: what was waited for did not come in time; also a :exc:`TimeoutError`.
  * :exc:`WrongThread`: a blocking call on the event loop's own thread, which would wait for itself.
  * :exc:`HandleClosed`: this program has closed the publisher or subscription that it uses.
  * :exc:`TransformUnavailable`: where a frame is was not to be learned; also a :exc:`LookupError`.
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
    """A service call or a goal that ended without an answer from its handler."""


class ServiceFailed(CallFailed):
    """The provider ran and said that it failed. A handler raises it to say why to its caller."""


class TimedOut(RobotError, TimeoutError):
    """What was waited for did not come in time."""


class CallTimeout(CallFailed, TimedOut):
    """No answer came in time."""


class ProviderGone(CallFailed):
    """The provider was unadvertised, replaced or disconnected before it answered."""


class NotFound(RobotError, LookupError):
    """Nothing of that name is there."""


class ProviderNotFound(CallFailed, NotFound):
    """Nobody offers the service or action."""


class GoalRejected(CallFailed):
    """The action server did not accept the goal."""


class InvalidQoS(RobotError, ValueError):
    """A policy with a number out of its range; the text names both."""


class ParameterRejected(RobotError, ValueError):
    """The node refused the parameter's value, or does not have that parameter."""


class WrongThread(RobotError, RuntimeError):
    """A call that blocks was made on the event loop's own thread; await the coroutine there."""


class HandleClosed(RobotError):
    """This program has closed the publisher or subscription that it uses."""


class TransformUnavailable(RobotError, LookupError):
    """Where a frame is was not to be learned in time; says which transform is missing."""


class ImageFormat(RobotError, ValueError):
    """An image in a format that has no counterpart, or with too few bytes."""


class GoalEnded(RobotError):
    """Base of what an action's `execute` raises to end its goal otherwise than by success.

    Attributes:
        result: the goal's result, None for one with default values.
        reason: for people: goes to the log, and to clients where the way to them has room for it.
    """

    def __init__(self, result: object = None, reason: str = "") -> None:
        super().__init__(reason or "the goal ended")
        self.result = result
        self.reason = reason


class GoalCanceled(GoalEnded):
    """Ends a goal as canceled, as was asked for."""


class GoalAborted(GoalEnded):
    """Ends a goal as aborted: it cannot be reached."""
