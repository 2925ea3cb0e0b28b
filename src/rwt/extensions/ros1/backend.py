"""Graph of a ROS 1 robot: the one in memory, joined to that of a ROS 1 master."""

from __future__ import annotations

import logging
import os
from functools import partial
from typing import TYPE_CHECKING, Final

import anyio.to_thread

from rwt.extensions.ros1.actions import Ros1Actions
from rwt.extensions.ros1.discovery import Discovery
from rwt.extensions.ros1.master import Master
from rwt.extensions.ros1.parameters import MasterParameters
from rwt.extensions.ros1.services import Ros1Services
from rwt.extensions.ros1.session import Session
from rwt.extensions.ros1.topics import Ros1Topics
from rwt.extensions.ros1.wire import rpc
from rwt.extensions.ros1.wire.addresses import master_uri, own_address
from rwt.extensions.ros1.wire.rpc import address_of
from rwt_graph.backend import DistributedGraph, Limitation, MemoryParticipant, Network
from rwt_graph.errors import Ros1Error
from rwt_graph.ros_time import RosTime
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.registry import Registry
from rwt_participant.qos import DEFAULT_QOS, QoS
from rwt_transports.errors import ListenError

if TYPE_CHECKING:
    from rwt_graph.api import Publisher
    from rwt_graph.clock import Clock
    from rwt_interfaces.structs import MessageType

logger = logging.getLogger(__name__)


#: Parameter that makes ROS time follow `/clock`, and seconds between two looks at it.
_USE_SIM_TIME: Final = "/use_sim_time"
_TIME_CHECK_SECONDS: Final = 1.0

_ROSOUT: Final = "/rosout"

#: How to add a type, at the end of errors about unknown ones.
_ADVICE: Final = (
    "; the type of a topic is known once a ROS 1 node publishes it: start that node, give the definition with"
    " --interfaces DIR, or use a standard type"
)


class Ros1Participant(MemoryParticipant):
    """Node whose publishers use the definition that a topic has on ROS 1, not that of the registry."""

    def advertise(self, topic: str, type: MessageType, qos: QoS = DEFAULT_QOS) -> Publisher:
        info = self.graph.topic(topic)
        if info is not None and info.type is not None and info.type.name == type.name:
            type = info.type
        return super().advertise(topic, type, qos)


class Ros1Graph(DistributedGraph):
    """Graph with nodes in this process and in ROS 1 programs.

    Nodes of one process communicate in memory, as in a :class:`~rwt_graph.MemoryGraph`. The graph joins ROS 1
    when it is entered, also if the master does not answer yet. `ROS_IP` and `ROS_HOSTNAME` apply.

    Args:
        registry: interfaces of a ROS 1 distribution; by default the standard ones.
        clock: by default real time, and that of `/clock` while the parameter `/use_sim_time` is true.
        master: `ros1://host:port`; by default `ROS_MASTER_URI`. With `ros1-master://host:port`, the graph is
            the master itself and listens there: other programs need no ROS core.

    Raises:
        Ros1Error: the registry is of ROS 2, or `master` is not an address.
    """

    limitations = frozenset((Limitation.QOS,))

    def __init__(
        self, registry: Registry | None = None, clock: Clock | None = None, *, master: str | None = None
    ) -> None:
        super().__init__(registry or Registry(NOETIC), clock or RosTime(is_real=True))
        if self.distro.serialisation != "ros1":
            raise Ros1Error(f"a graph of {self.distro.name} cannot join ROS 1: use --distro noetic")
        self.master = master_uri(master)
        self._is_master = master is not None and master.startswith("ros1-master")
        self.parameters = self._master_parameters = MasterParameters()
        self.registry.advice = _ADVICE
        self._ros_topics = Ros1Topics(self.topic_table)
        self._ros_services = Ros1Services(self.service_table)
        #: Membership in ROS 1 while the graph runs.
        self.session: Session | None = None
        self._time_source: MemoryParticipant | None = None
        self._ros_actions = Ros1Actions(self, self._ros_topics)
        self.set_remotes(self._ros_topics, self._ros_services, self._ros_actions)

    @property
    def network(self) -> Network | None:
        session = self.session
        if session is None:
            return None
        answer = "" if session.has_master else ", which does not answer"
        # A core's own node is there without a robot.
        others = self.remote_nodes - (_ROSOUT in {each.name for each in self.nodes()} and not self._is_master)
        return Network(
            "ROS 1",
            f"master at {self.master}{answer}, this process at {session.address.host}",
            others,
            "start the robot's nodes with ROS_MASTER_URI set to that master, and run"
            f" `rwt doctor {self.master.replace('http', 'ros1', 1)}`",
        )

    def make_participant(self, name: str) -> MemoryParticipant:
        return Ros1Participant(self, name)

    async def join(self) -> None:
        """Join ROS 1.

        Raises:
            Ros1Error: no socket can be opened, or the port of the own master is in use.
        """
        address = await anyio.to_thread.run_sync(own_address, self.master)  # May ask name servers.
        try:
            session = self.session = Session(self, self.master, address)
            await session.monitor.open()
            if self._is_master:
                bind, port = address_of(self.master)
                master = Master(session.network, f"http://{address.host}:{port}/")
                calls = rpc.serve(session.network, bind, master.dispatch, port)
                await session.network.open(calls, "calls of the ROS 1 master")
                self._collect_logs()
        except (ListenError, OSError) as error:
            raise Ros1Error(f"cannot accept connections of ROS 1 at {self.master}: {error}") from error
        parameters = self._master_parameters
        session.on_parameter = parameters.on_update
        parameters.warn_once = session.warn_once

        def repeat() -> None:
            session.registrar.repeat()
            parameters.resynchronise()

        session.on_forgotten = repeat
        discovery = Discovery(self, session, self._ros_topics, self._ros_services)
        self._ros_topics.open(session, discovery)
        self._ros_services.open(session)
        self._ros_actions.session = session
        try:
            await discovery.poll()
            await parameters.join(session)
        except Ros1Error as error:
            session.on_master_error(error)
        else:
            logger.info("joined ROS 1 at %s, as %s", self.master, session.address.host)
        self.spawn(session.registrar.run, "registrations at the ROS 1 master")
        self.spawn(discovery.run, "discovery of ROS 1")
        self.spawn(partial(parameters.run, session), "parameters of ROS 1")
        self.spawn(session.keep_sweeping, "connections of ROS 1")
        self._check_time()

    def _check_time(self) -> None:
        """Follow `/use_sim_time`, now and every second."""
        clock, tree = self.clock, self.parameters
        if isinstance(clock, RosTime):
            is_real = not (tree.has(_USE_SIM_TIME) and tree.get(_USE_SIM_TIME) is True)
            if is_real and self._time_source is not None:
                clock.unfollow()
                self._time_source.close()
                self._time_source = None
            elif not is_real and self._time_source is None:
                # No node of this graph, which would be listed.
                self._time_source = self.make_participant(f"/rwt_clock_{os.getpid()}")
                clock.follow(self._time_source)
            clock.call_later(_TIME_CHECK_SECONDS, self._check_time)

    def _collect_logs(self) -> None:
        """Repeat the messages of `/rosout` on `/rosout_agg`, as ROS 1's node of that name does."""
        node = self.participant(_ROSOUT)
        type = self.registry.message(self.distro.rosout_type)
        collected = node.advertise("/rosout_agg", type)
        node.subscribe(_ROSOUT, lambda sample: collected.publish(sample.payload), type)

    async def leave(self) -> None:
        session = self.session
        if self._time_source is not None:
            self._time_source.close()
        try:
            if session is not None:
                await session.registrar.leave()
        finally:
            self.session = self._ros_actions.session = None
            self._ros_topics.close()
            self._ros_services.close()
            if session is not None:
                session.close()
