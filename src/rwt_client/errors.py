"""Everything that `rwt_client` raises.

* :exc:`ClientError`

  * :exc:`BadAddress`: a URL that names no robot; also a :exc:`ValueError`.
  * :exc:`ConnectionLost`: the connection was lost, or could not be had, and this was not done.

    * :exc:`CannotConnect`: the first connection could not be had.
    * :exc:`NotConnected`: there is no connection now; another attempt may be under way.
    * :exc:`ConnectionClosed`: this program has closed the connection.

  * :exc:`NoAnswer`: nothing came in time; also a :exc:`TimeoutError`.
  * :exc:`ServerRefused`: the server said no; the text is the server's.

    * :exc:`CallFailed`: a service that failed or is not there.
    * :exc:`GoalFailed`: an action that could not run the goal.
    * :exc:`ParameterRefused`: a parameter that is not there, or cannot have that value.

  * :exc:`MisfitMessage`: a message does not fit its type.
  * :exc:`TypeUnavailable`: a type is in neither the robot's graph nor the standard set; also a
    :exc:`LookupError`.
  * :exc:`TransformUnavailable`: where a frame is cannot be told; also a :exc:`LookupError`.
  * :exc:`ImageFormat`: an image that cannot be converted.
  * :exc:`GoalEnded`: raised *by* an action's `execute`, to end its goal otherwise than by success.

    * :exc:`GoalCanceled`: as canceled.
    * :exc:`GoalAborted`: as aborted.

  * :exc:`ServiceFailed`: raised *by* a service's handler, to tell the caller why there is no answer.
"""

from __future__ import annotations


class ClientError(Exception):
    """Base of every error of this package. The text says what, where and what instead."""


class ConnectionLost(ClientError, ConnectionError):
    """The connection was lost or could not be had, and what was asked for was not done."""


class BadAddress(ClientError, ValueError):
    """A URL that cannot be connected to; says what is wrong with it."""


class CannotConnect(ConnectionLost):
    """Nobody answers there, or who answers does not let this program in."""


class NotConnected(ConnectionLost):
    """There is no connection now."""


class ConnectionClosed(ConnectionLost):
    """This program has closed the connection."""


class NoAnswer(ClientError, TimeoutError):
    """Nothing came in time."""


class ServerRefused(ClientError):
    """The server did not do it. The text is the server's."""


class CallFailed(ServerRefused):
    """The service failed, or is not there. The text is the server's."""


class GoalFailed(ServerRefused):
    """The action did not run the goal, or failed at it. The text is the server's."""


class ParameterRefused(ServerRefused):
    """The parameter is not there, or cannot have that value. The text is the server's."""


class MisfitMessage(ClientError, ValueError):
    """A message that does not fit its type; says where and why."""


class TypeUnavailable(ClientError, LookupError):
    """Neither the robot's graph nor the standard set has that type."""


class TransformUnavailable(ClientError, LookupError):
    """Where a frame is was not to be learned in time; says which transform is missing."""


class ImageFormat(ClientError, ValueError):
    """An image in a format that has no counterpart, or with too few bytes."""


class ServiceFailed(ClientError):
    """Raised by a service's handler: the caller is told this text."""


class GoalEnded(ClientError):
    """Base of what an action's `execute` raises to end its goal otherwise than by success.

    Attributes:
        result: the result that the client gets, None for one with default values.
    """

    def __init__(self, result: object = None, reason: str = "") -> None:
        super().__init__(reason or "the goal ended")
        self.result = result
        self.reason = reason


class GoalCanceled(GoalEnded):
    """Ends a goal as canceled."""


class GoalAborted(GoalEnded):
    """Ends a goal as aborted."""
