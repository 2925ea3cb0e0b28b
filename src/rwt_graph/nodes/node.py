"""Nodes of robot programs: typed messages, coroutines and plain functions, safe from every thread.

A node depends only on the contract in :mod:`rwt_graph.api`, so it works on every backend::

    graph = MemoryGraph()
    node = Node(graph, "talker")
    chatter = node.advertise("chatter", "std_msgs/String")
    async with graph:
        chatter.publish({"data": "hello"})

Threads: once the graph runs, every plain method may be called from any thread. Those that return something
wait for the graph's thread; `publish` does not. Coroutines are awaited on the graph's event loop; from
another thread, use :meth:`Node.run_blocking`.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING, Final, TypeVar

from rwt_graph.api import Graph
from rwt_graph.errors import NotRunning
from rwt_graph.nodes.actionlib import ActionlibServer
from rwt_graph.nodes.graph_robot import GraphRobot, GraphServer
from rwt_graph.nodes.logs import NodeLog, rosout_qos
from rwt_graph.parameters.node_parameters import NodeParameters, NodeStore, TreeStore
from rwt_graph.parameters.services import EVENTS_QOS, ParameterEvents, ParameterServices
from rwt_participant.errors import WrongThread
from rwt_participant.handles import Handle
from rwt_participant.messages import ParameterValue

if TYPE_CHECKING:
    from rwt_graph.nodes.blocking import BlockingGraphNode

T = TypeVar("T")

_DESCRIPTION: Final = "robot_description"


class Node(GraphRobot):
    """Node of the graph, with the log, the parameters and the services that every ROS node has.

    Args:
        graph: any backend.
        name: name of the node (`talker`), or its absolute one.
        namespace: namespace that relative names are resolved in.
        timeout: default timeout of calls and queries, in seconds of the graph's clock; None waits without
            limit, as in ROS.

    Attributes:
        name: absolute name.
        log: log of the node, written to `/rosout` and Python's logging.
        parameters: parameters that the node itself declares.
        params: parameters of all nodes.

    Raises:
        InvalidGraphName: ROS does not allow the name or the namespace.
    """

    def __init__(
        self, graph: Graph, name: str, namespace: str = "/", *, timeout: float | None = None
    ) -> None:
        super().__init__(graph, name, namespace, timeout=timeout)
        rosout = self.advertise("/rosout", graph.distro.rosout_type, qos=rosout_qos(graph.distro))
        self.log = NodeLog(self.name, graph.distro, rosout)
        self.parameters = self._make_parameters()
        if graph.distro.nodes_have_loggers:
            self.advertise_service("~/get_loggers", "roscpp/GetLoggers", self.log.loggers)
            self.advertise_service("~/set_logger_level", "roscpp/SetLoggerLevel", self.log.set_level)

    def _make_parameters(self) -> NodeParameters:
        if not self.distro.parameters_belong_to_nodes:
            tree = TreeStore(self.graph.parameters, self.name)
            return NodeParameters(self.name, tree, True, self.run)
        publisher = self.advertise("/parameter_events", "rcl_interfaces/ParameterEvent", qos=EVENTS_QOS)
        events = ParameterEvents(self.name, self.distro, publisher)
        parameters = NodeParameters(self.name, NodeStore(events.stored), False, self.run)
        for name, interface, handler in ParameterServices(parameters).handlers():
            self.advertise_service(f"~/{name}", interface, handler)
        parameters.declare(
            "use_sim_time",
            not self.clock.is_real,
            description="value of `use_sim_time` as set; the node always uses the clock of its graph",
            on_change=self._on_use_sim_time,
        )
        return parameters

    def _on_use_sim_time(self, value: ParameterValue) -> None:
        """Warn if the parameter contradicts the clock of the graph, which all its nodes share."""
        simulated = not self.clock.is_real
        if value != simulated:
            said, kind = ("true", "real") if value else ("false", "simulated")
            text = f"use_sim_time is {said} now; the time is still that of the graph, which is {kind}"
            self.log.warning(text)

    def serve_over_topics(self, action: str, type: str) -> GraphServer:
        """Offer an action of this node over the topics of ROS 1 as well (ALB-01), for clients of actionlib.

        On ROS 1 :meth:`advertise_action` does so. There the status is always published; here only while there
        are goals.

        Args:
            action: action that this node offers; once it is withdrawn, goals over topics get no answer.
            type: type name of the action over topics; its fields are those of the action's own type.

        Raises:
            UnknownType: there is no such action type.
            InvalidGraphName: ROS does not allow the name.
        """
        name, interface = self.resolve(action), self.registry.action(type)

        def serve() -> GraphServer:
            topics = ActionlibServer(
                self.graph, self._participant, name, interface, self.create_timer, idle_status=False
            )
            return GraphServer(self.graph, name, topics.close)

        return self.run(serve)

    def describe(self, urdf: str, *, frame_prefix: str = "", publish_frequency: float = 100.0) -> Handle:
        """Publish the robot's description; see :meth:`~rwt_participant.api.RobotApi.describe`.

        The parameter `robot_description` has it, too: of this node on ROS 2, in its namespace on ROS 1.
        """
        handle = super().describe(urdf, frame_prefix=frame_prefix, publish_frequency=publish_frequency)
        if self.distro.parameters_belong_to_nodes:
            if self.parameters.has(_DESCRIPTION):
                self.parameters.undeclare(_DESCRIPTION)
            self.parameters.declare(_DESCRIPTION, urdf, description="The robot as URDF.", read_only=True)
        else:
            name = self.resolve(_DESCRIPTION)
            self.graph.run_on_graph(lambda: self.graph.parameters.set(name, urdf))
        return handle

    @property
    def blocking(self) -> BlockingGraphNode:
        """The same node for other threads: its verbs block until they are answered."""
        from rwt_graph.nodes.blocking import BlockingGraphNode

        return BlockingGraphNode(self)

    def run_blocking(self, function: Callable[[], Awaitable[T]]) -> T:
        """Run a coroutine function on the graph's event loop, and return its result.

        For threads: `node.run_blocking(lambda: node.params.get("/robot:speed"))`.

        Raises:
            WrongThread: called on the graph's own thread, which would wait for itself.
            NotRunning: the graph does not run on an event loop, or was left meanwhile.
        """
        if not self.graph.running:
            raise NotRunning("a blocking call needs a running graph: enter it with 'async with graph'")
        if self.graph.on_graph_thread():
            raise WrongThread(
                "a blocking call on the graph's own thread would wait for itself: await it instead"
            )
        outcome: Future[T] = Future()

        async def run() -> None:
            try:
                result = await function()
            except Exception as error:
                outcome.set_exception(error)
            except BaseException:
                outcome.set_exception(NotRunning("the graph was left during a blocking call"))
                raise
            else:
                outcome.set_result(result)

        def begin() -> None:
            try:
                self.graph.spawn(run, f"blocking call of {self.name}")
            except NotRunning as error:
                outcome.set_exception(error)

        self.graph.run_on_graph(begin)
        return outcome.result()

    def _close(self) -> None:
        self.parameters.close()
        super()._close()

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
