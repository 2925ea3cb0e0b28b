"""Topics, services, actions, parameters and nodes: a robot graph that needs no ROS.

Robot programs use :class:`MemoryGraph` and :class:`Node`; :mod:`rwt_graph.api` is what backends implement.
"""

from rwt_graph.api import GoalStatus, Graph, Sample
from rwt_graph.clock import Clock, SimulatedClock, SteadyClock, Timer, WallClock
from rwt_graph.errors import (
    CallFailed,
    CallTimeout,
    GoalAborted,
    GoalCanceled,
    GoalRejected,
    GraphError,
    InvalidGraphName,
    InvalidTransition,
    NotFound,
    NotRunning,
    ParameterRejected,
    ProviderGone,
    ProviderNotFound,
    ServiceFailed,
    TypeConflict,
    WrongThread,
)
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.program.endpoints import Message, MessageLike, TopicPublisher, TopicSubscription
from rwt_graph.program.goals import ActionGoal, GoalHandle
from rwt_graph.program.node import Handle, Node
from rwt_graph.qos import BEST_AVAILABLE, LATCHED, SENSOR_DATA, Durability, History, QoS, Reliability

__all__ = [
    "MemoryGraph",
    "Node",
    "Handle",
    "Message",
    "MessageLike",
    "TopicPublisher",
    "TopicSubscription",
    "Sample",
    "GoalStatus",
    "ActionGoal",
    "GoalHandle",
    "Graph",
    "Clock",
    "WallClock",
    "SteadyClock",
    "SimulatedClock",
    "Timer",
    "QoS",
    "History",
    "Reliability",
    "Durability",
    "BEST_AVAILABLE",
    "LATCHED",
    "SENSOR_DATA",
    "GraphError",
    "InvalidGraphName",
    "TypeConflict",
    "NotFound",
    "InvalidTransition",
    "CallFailed",
    "ServiceFailed",
    "CallTimeout",
    "ProviderGone",
    "ProviderNotFound",
    "GoalRejected",
    "GoalCanceled",
    "GoalAborted",
    "ParameterRejected",
    "NotRunning",
    "WrongThread",
]
