"""Everything that `rwt_graph` raises.

* :exc:`GraphError`

  * :exc:`InvalidGraphName`: not a topic, service, action, node or parameter name that ROS allows.
  * :exc:`TypeConflict`: the name is established with another type.
  * :exc:`NotFound`: no such topic, service, action, node or parameter.
  * :exc:`InvalidTransition`: the goal is in a state that forbids this.
  * :exc:`CallFailed`: a service call or goal that ended without an answer from its handler.

    * :exc:`ServiceFailed`: the provider answered that it failed.
    * :exc:`CallTimeout`: no answer in time.
    * :exc:`ProviderGone`: the provider went away first.
    * :exc:`ProviderNotFound`: nobody offers that service or action; also a :exc:`NotFound`.
    * :exc:`GoalRejected`: the action server did not accept the goal.

  * :exc:`ParameterRejected`: the node refused the value.
  * :exc:`NotRunning`: this needs an event loop, and the graph is not (or no longer) on one.
  * :exc:`WrongThread`: a blocking call on the graph's own thread, which would wait for itself.
  * :exc:`GoalEnded`: raised by an action's `execute` to end its goal otherwise than by success.

    * :exc:`GoalCanceled`: as canceled.
    * :exc:`GoalAborted`: as aborted.
"""

from __future__ import annotations


class GraphError(Exception):
    """Base of every error of this package. The text says what, where and what instead."""


class InvalidGraphName(GraphError, ValueError):
    """A name that ROS does not allow."""


class TypeConflict(GraphError, ValueError):
    """The name is already established with another type."""


class NotFound(GraphError, LookupError):
    """Nothing of that name is in the graph."""


class InvalidTransition(GraphError, RuntimeError):
    """The goal's state forbids this; see the table in :mod:`rwt_graph.memory.actions`."""


class CallFailed(GraphError):
    """A service call or a goal that ended without success."""


class ServiceFailed(CallFailed):
    """The provider ran and said that it failed."""


class CallTimeout(CallFailed, TimeoutError):
    """No answer came in time."""


class ProviderGone(CallFailed):
    """The provider was unadvertised, replaced or disconnected before it answered."""


class ProviderNotFound(CallFailed, NotFound):
    """Nobody offers the service or action."""


class GoalRejected(CallFailed):
    """The action server did not accept the goal."""


class ParameterRejected(GraphError, ValueError):
    """The node refused the parameter's value, or does not have that parameter."""


class NotRunning(GraphError, RuntimeError):
    """The graph is not on an event loop: enter it with `async with graph`."""


class WrongThread(GraphError, RuntimeError):
    """A call that blocks was made on the graph's own thread; use the coroutine of the same name there."""


class GoalEnded(GraphError):
    """Base of what an action's `execute` raises to end its goal.

    Attributes:
        result: the goal's result, or None for one of defaults.
        reason: for people, goes to the log and to in-process clients.
    """

    def __init__(self, result: object = None, reason: str = "") -> None:
        super().__init__(reason)
        self.result = result
        self.reason = reason


class GoalCanceled(GoalEnded):
    """The goal was canceled, as was asked for."""


class GoalAborted(GoalEnded):
    """The goal cannot be reached."""
