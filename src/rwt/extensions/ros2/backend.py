"""Graph of a ROS 2 robot: the one in memory, connected to ROS 2's."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable

from rwt.extensions.ros2.ament import add_installed, installed_release
from rwt.extensions.ros2.connection import Connection
from rwt.extensions.ros2.discovery import Discovery
from rwt.extensions.ros2.rcl import middleware
from rwt.extensions.ros2.remapping import RemappedParticipant, Remapping
from rwt.extensions.ros2.services import Ros2Services
from rwt.extensions.ros2.topics import Ros2Topics
from rwt.extensions.ros2.type_supports.described_types import DescribedTypes
from rwt_graph.api import ActionInfo, ServiceInfo, TopicInfo
from rwt_graph.backend import DistributedGraph, Limitation, MemoryParticipant, Network, Ros2Actions
from rwt_graph.clock import Clock
from rwt_graph.errors import InvalidGraphName, Ros2Error
from rwt_graph.names import validate
from rwt_graph.ros_time import RosTime
from rwt_interfaces.registry import Registry

logger = logging.getLogger(__name__)

#: Seconds for which feedback of an action is received after a goal has ended.
_FEEDBACK_LINGERS_SECONDS = 10.0

_NETWORK_ADVICE = (
    "start the robot; give this server the ROS_DOMAIN_ID, RMW_IMPLEMENTATION and discovery range of its"
    " programs, and compare with `ros2 node list` on the robot; where UDP multicast does not pass, set"
    " ROS_STATIC_PEERS to the robot's address"
)


def _details(domain: int) -> str:
    """Return the settings by which programs of ROS 2 find each other."""
    peers = os.environ.get("ROS_STATIC_PEERS", "")
    if os.environ.get("ROS_LOCALHOST_ONLY") == "1":
        reach = "LOCALHOST"
    else:
        reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    only = ", programs of this host only" if reach == "LOCALHOST" and not peers else ""
    listed = f", static peers {peers}" if peers else ""
    return f"domain {domain}, {middleware()}, discovery range {reach}{only}{listed}"


class Ros2Graph(DistributedGraph):
    """Graph with nodes in this process and in ROS 2 programs.

    Nodes of one process communicate in memory, as in a :class:`~rwt_graph.MemoryGraph`. The graph joins ROS 2
    when it is entered. `ROS_DOMAIN_ID`, `ROS_AUTOMATIC_DISCOVERY_RANGE`, `RMW_IMPLEMENTATION` and the other
    variables of ROS 2 apply. The global tree of parameters stays in the process.

    Topics, services and actions are exchanged with ROS 2. Its services have no errors: a caller in another
    process receives no answer from a service of this one that fails.

    Args:
        registry: interfaces of a ROS 2 distribution; by default the standard ones of the installed release,
            and those that are installed with it.
        clock: the wall clock by default.
        use_sim_time: take ROS time from the topic `/clock`; replaces `clock`.
        domain: ROS_DOMAIN_ID; that of the environment by default.
        use_callbacks: False to wait for samples in a thread, as with middlewares without callbacks.
        remap: rules as after `--ros-args -r`, such as `/cmd_vel:=/input/cmd_vel`: nodes of this process and
            lookups of one name use the new name; listings show it.

    Raises:
        Ros2Error: the registry is of ROS 1, or a remapping rule is invalid.
    """

    limitations = frozenset(
        (
            Limitation.SERVICE_ERRORS,
            Limitation.CALL_END,
            Limitation.GOAL_REASONS,
            Limitation.LIFESPAN,
            Limitation.SUBSCRIBER_COUNT,
            Limitation.PARAMETER_TREE,
        )
    )

    def __init__(
        self,
        registry: Registry | None = None,
        clock: Clock | None = None,
        *,
        use_sim_time: bool = False,
        domain: int | None = None,
        use_callbacks: bool = True,
        remap: Iterable[str] = (),
    ) -> None:
        self._remapping = Remapping(remap)
        if registry is None:
            registry = Registry(installed_release())
            add_installed(registry)
        super().__init__(registry, RosTime(is_real=False) if use_sim_time else clock)
        if self.distro.ros_version != 2:
            raise Ros2Error(
                f"a graph of {self.distro.name} cannot join ROS 2: use the graph in memory, "
                "or a ROS 2 distribution"
            )
        self._domain = domain
        self._use_callbacks = use_callbacks
        self._connection: Connection | None = None
        self._time_source: MemoryParticipant | None = None
        self._ros_topics = Ros2Topics(
            self.topic_table, self.clock, self.problems, lambda topic: self.may_retain(topic)
        )
        types = DescribedTypes(self.registry)
        self._ros_services = Ros2Services(self.service_table, types, self.clock, self.problems)
        self._discovery = Discovery(self, self._ros_topics, self._ros_services, types)
        actions = Ros2Actions(
            self.topic_table,
            self.service_table,
            self._ros_services,
            self.registry,
            linger=_FEEDBACK_LINGERS_SECONDS,
        )
        self.set_remotes(self._ros_topics, self._ros_services, actions)

    @property
    def network(self) -> Network | None:
        connection = self._connection
        if connection is None:
            return None
        return Network(
            f"ROS 2 {self.distro.name}", _details(connection.domain), self.remote_nodes, _NETWORK_ADVICE
        )

    def participant(self, name: str, *, for_clients: bool = False) -> MemoryParticipant:
        node = self._remapping.node(validate(name))
        participant = super().participant(node, for_clients=for_clients)
        if self._connection is not None:
            try:
                self._connection.node_of(participant.owner)
            except ValueError as error:
                participant.close()
                raise InvalidGraphName(f"{name} is not a node name in ROS 2: {error}") from None
        return participant

    def make_participant(self, name: str) -> MemoryParticipant:
        return RemappedParticipant(self, name, self._remapping)

    def topic(self, name: str) -> TopicInfo | None:
        return super().topic(self._remapping.name(name))

    def service(self, name: str) -> ServiceInfo | None:
        return super().service(self._remapping.name(name))

    def action(self, name: str) -> ActionInfo | None:
        return super().action(self._remapping.name(name))

    def left(self, participant: MemoryParticipant) -> None:
        super().left(participant)
        if self._connection is not None:
            self._connection.forget_node(participant.owner)

    async def join(self) -> None:
        """Join ROS 2.

        Raises:
            Ros2Error: ROS 2 rejects the settings, such as the domain.
        """
        connection = Connection(
            self, self._domain, self._discovery.on_change, use_callbacks=self._use_callbacks
        )
        self._connection = connection
        for participant in self.participants:
            connection.node_of(participant.owner)
        self._discovery.open(connection)
        self._ros_topics.open(connection)
        self._ros_services.open(connection)
        connection.wakeups.start()
        if isinstance(self.clock, RosTime):
            # No node of the graph, which would be listed.
            self._time_source = self.make_participant(f"/_rwt_clock_{os.getpid()}")
            self.clock.follow(self._time_source)
        logger.info("joined ROS 2 %s in domain %d", self.distro.name, connection.domain)
        installed = installed_release()
        if installed is not self.distro:
            logger.warning(
                "ROS 2 %s is installed, and this server has the messages of %s: leave out --distro to have"
                " those of the installed release",
                installed.name,
                self.distro.name,
            )

    async def leave(self) -> None:
        if self._time_source is not None:
            self._time_source.close()
        connection, self._connection = self._connection, None
        self._discovery.close()
        self._ros_topics.close()
        self._ros_services.close()
        if connection is not None:
            connection.close()
