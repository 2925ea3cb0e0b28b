"""Topics, services, actions, parameters and nodes: a robot graph that needs no ROS.

Robot programs use :class:`MemoryGraph` and :class:`Node`; :mod:`rwt_graph.api` is what backends implement.
"""

from rwt_graph.api import Graph, Sample
from rwt_graph.clock import Clock, SimulatedClock, SteadyClock, Timer, WallClock
from rwt_graph.errors import (
    GraphError,
    InvalidGraphName,
    InvalidTransition,
    NotRunning,
    TypeConflict,
)
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.program.endpoints import TopicPublisher, TopicSubscription
from rwt_graph.program.node import ActionServer, Node, ServiceServer
from rwt_program.errors import (
    CallFailed,
    CallTimeout,
    GoalAborted,
    GoalCanceled,
    GoalEnded,
    GoalRejected,
    HandleClosed,
    InterfaceError,
    InvalidMessage,
    InvalidQoS,
    NotFound,
    ParameterRejected,
    ProviderGone,
    ProviderNotFound,
    RobotError,
    ServiceFailed,
    TimedOut,
    TransformUnavailable,
    UnknownType,
    WrongThread,
)
from rwt_program.goals import Goal, GoalResult, GoalStatus, ReceivedGoal
from rwt_program.messages import Message, MessageLike
from rwt_program.qos import BEST_AVAILABLE, LATCHED, SENSOR_DATA, Durability, History, QoS, Reliability

__all__ = [
    "MemoryGraph",
    "Node",
    "ServiceServer",
    "ActionServer",
    "Message",
    "MessageLike",
    "TopicPublisher",
    "TopicSubscription",
    "Sample",
    "GoalStatus",
    "Goal",
    "GoalResult",
    "ReceivedGoal",
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
    "RobotError",
    "CallFailed",
    "ServiceFailed",
    "CallTimeout",
    "ProviderGone",
    "ProviderNotFound",
    "GoalRejected",
    "NotFound",
    "InvalidQoS",
    "ParameterRejected",
    "TimedOut",
    "HandleClosed",
    "TransformUnavailable",
    "GoalEnded",
    "GoalCanceled",
    "GoalAborted",
    "InterfaceError",
    "InvalidMessage",
    "UnknownType",
    "GraphError",
    "InvalidGraphName",
    "TypeConflict",
    "InvalidTransition",
    "NotRunning",
    "WrongThread",
]
