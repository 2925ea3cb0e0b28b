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
    * :exc:`GoalRejected`: the action server did not accept the goal.

  * :exc:`ParameterRejected`: the node refused the value.
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
    """The goal's state forbids this; see the table in :mod:`rwt_graph.actions`."""


class CallFailed(GraphError):
    """A service call or a goal that ended without success."""


class ServiceFailed(CallFailed):
    """The provider ran and said that it failed."""


class CallTimeout(CallFailed, TimeoutError):
    """No answer came in time."""


class ProviderGone(CallFailed):
    """The provider was unadvertised, replaced or disconnected before it answered."""


class GoalRejected(CallFailed):
    """The action server did not accept the goal."""


class ParameterRejected(GraphError, ValueError):
    """The node refused the parameter's value, or does not have that parameter."""
