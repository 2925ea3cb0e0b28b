"""Errors of the graph, in addition to those of every robot program (:mod:`rwt_participant.errors`).

* :exc:`GraphError`

  * :exc:`InvalidGraphName`: not a topic, service, action, node or parameter name that ROS allows.
  * :exc:`TypeConflict`: the name is established with another type.
  * :exc:`InvalidTransition`: the goal is in a state that forbids this.
  * :exc:`NotRunning`: this needs an event loop, and the graph is not (or no longer) on one.
  * :exc:`ZenohError`: the Zenoh session cannot be opened as asked.
  * :exc:`WireError`: another program sent a key, token or attachment that is not rmw_zenoh's.
"""

from __future__ import annotations

from rwt_participant.errors import RobotError


class GraphError(RobotError):
    """Base of the errors that only a graph raises."""


class InvalidGraphName(GraphError, ValueError):
    """A name that ROS does not allow."""


class TypeConflict(GraphError, ValueError):
    """The topic is already established with another type.

    Args:
        topic: its name.
        asked: the type that was asked for, as the robot's distribution spells it.
        established: the type that it has.
    """

    def __init__(self, topic: str, asked: str, established: str) -> None:
        super().__init__(
            f"tried to register topic {topic} with type {asked} "
            f"but it is already established with type {established}"
        )


class InvalidTransition(GraphError, RuntimeError):
    """The goal's state forbids this; see the table in :mod:`rwt_graph.memory.actions`."""


class NotRunning(GraphError, RuntimeError):
    """The graph is not on an event loop: enter it with `async with graph`."""


class ZenohError(GraphError):
    """The Zenoh session cannot be opened as asked; the text says what to change."""


class WireError(GraphError, ValueError):
    """A key, token or attachment that another program sent is not written as rmw_zenoh writes it."""
