"""Robot graph without ROS: topics, services, actions, parameters and nodes.

Robot programs use :class:`MemoryGraph` and :class:`Node`; :mod:`rwt_graph.api` is what backends implement.
"""

from rwt_graph.accounts import Release, hold_for_asker
from rwt_graph.api import Graph, Sample
from rwt_graph.clock import Clock, SimulatedClock, SteadyClock, WallClock
from rwt_graph.errors import (
    GraphError,
    InvalidGraphName,
    InvalidTransition,
    NotRunning,
    TypeConflict,
)
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.nodes.endpoints import TopicPublisher, TopicSubscription
from rwt_graph.nodes.graph_robot import GraphRobot, GraphServer
from rwt_graph.nodes.node import Node
from rwt_participant.timers import Timer

__all__ = [
    "MemoryGraph",
    "Node",
    "GraphRobot",
    "GraphServer",
    "TopicPublisher",
    "TopicSubscription",
    "Sample",
    "Graph",
    "Clock",
    "WallClock",
    "SteadyClock",
    "SimulatedClock",
    "Timer",
    "Release",
    "hold_for_asker",
    "GraphError",
    "InvalidGraphName",
    "TypeConflict",
    "InvalidTransition",
    "NotRunning",
]
