"""Errors of the graph, in addition to those of every robot program (:mod:`rwt_participant.errors`)."""

from __future__ import annotations

from rwt_participant.errors import RobotError


class GraphError(RobotError):
    """Base of the errors that only a graph raises."""


class InvalidGraphName(GraphError, ValueError):
    """ROS does not allow the name."""


class TypeConflict(GraphError, ValueError):
    """The topic is already established with another type.

    The robot's endpoints establish it for all. Those of clients of a server establish it for other clients
    only, and end when the robot's bring another type.

    Args:
        topic: name of the topic.
        asked: requested type, as the robot's distribution spells it.
        established: type of the topic.
    """

    def __init__(self, topic: str, asked: str, established: str) -> None:
        super().__init__(
            f"tried to register topic {topic} with type {asked} "
            f"but it is already established with type {established}"
        )


class InvalidTransition(GraphError, RuntimeError):
    """The operation is not allowed in the goal's state; see :mod:`rwt_graph.memory.actions`."""


class NotRunning(GraphError, RuntimeError):
    """The graph is not on an event loop: enter it with `async with graph`."""


class ZenohError(GraphError):
    """The Zenoh session cannot be opened with these options; the text says what to change."""


class Ros2Error(GraphError):
    """ROS 2 is not installed or rejects a request; the text says what to change."""


class Ros1Error(GraphError):
    """A ROS 1 program cannot be reached or rejects a request; the text says which, and why."""


class WireError(GraphError, ValueError):
    """Another program sent bytes that do not have the form of its protocol: rmw_zenoh's or ROS 1's."""
