"""Graph that spans processes and hosts: the one in memory, connected to others over Zenoh."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from os import PathLike

import anyio
import anyio.to_thread

from rwt.extensions.zenoh.discovery import Discovery
from rwt.extensions.zenoh.link import Presence, ZenohLink
from rwt.extensions.zenoh.services import ZenohServices
from rwt.extensions.zenoh.session import Mode, ZenohOptions, ZenohSession
from rwt.extensions.zenoh.topics import ZenohTopics
from rwt_graph import Node
from rwt_graph.backend import DistributedGraph, Limitation, MemoryParticipant, NodeResources, Ros2Actions
from rwt_graph.clock import Clock
from rwt_graph.errors import ZenohError
from rwt_graph.names import resolve
from rwt_interfaces.registry import Registry

logger = logging.getLogger(__name__)


class ZenohGraph(DistributedGraph):
    """Graph with nodes in this process and in others.

    Nodes of one process communicate in memory, as in a :class:`~rwt_graph.MemoryGraph`. The graph connects
    when it is entered; leaving it always closes the Zenoh session. The graph's own `/rosout` and `/clock` and
    the global tree of parameters stay in the process; the topics and parameters of its nodes do not.

    Differences to one process:

    * Changes in other processes are seen with a delay.
    * A service or action of two processes exists twice, and each process calls its own first.
    * If two processes establish a topic with different types at the same moment, both succeed, but receive
      nothing from each other.

    Args:
        registry: interfaces of a ROS 2 distribution, with the same types as in all other processes.
        clock: the wall clock by default.
        listen, connect, domain, multicast, config, mode: see :class:`ZenohOptions`.
        namespace: namespace of relative node names given to :meth:`node`, such as one per robot of a fleet.

    Raises:
        ZenohError: the registry is of ROS 1, which rmw_zenoh does not support.
        InvalidGraphName: ROS does not allow `namespace`.
    """

    limitations = frozenset((Limitation.PARAMETER_TREE,))

    def __init__(
        self,
        registry: Registry | None = None,
        clock: Clock | None = None,
        *,
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        domain: int = 0,
        multicast: bool | None = None,
        config: str | PathLike[str] | None = None,
        mode: Mode | None = None,
        namespace: str = "/",
    ) -> None:
        self.options = ZenohOptions(tuple(listen), tuple(connect), mode, multicast, config, domain)
        self.namespace = namespace if namespace == "/" else resolve(namespace)
        super().__init__(registry, clock)
        if not self.distro.joins_over_zenoh:
            raise ZenohError(
                f"a graph of {self.distro.name} cannot be joined over Zenoh: the wire is that of ROS 2; "
                "use the graph in memory, or a ROS 2 distribution"
            )
        self._session = ZenohSession()
        #: Link to other programs while the graph runs.
        self.link: ZenohLink | None = None
        self._present: dict[NodeResources, Presence] = {}
        self._zenoh_topics = ZenohTopics(self.topic_table)
        self._zenoh_services = ZenohServices(self.service_table, self.registry, self.clock.time_ns)
        self._discovery = Discovery(self, self._zenoh_topics, self._zenoh_services)
        actions = Ros2Actions(self.topic_table, self.service_table, self._zenoh_services, self.registry)
        self.set_remotes(self._zenoh_topics, self._zenoh_services, actions)

    def node(self, name: str, namespace: str | None = None) -> Node:
        """Return a new :class:`~rwt_graph.nodes.node.Node`, in the graph's namespace by default."""
        return Node(self, name, self.namespace if namespace is None else namespace)

    def participant(self, name: str, *, for_clients: bool = False) -> MemoryParticipant:
        participant = super().participant(name, for_clients=for_clients)
        if self.link is not None:
            self._present[participant.owner] = self.link.declare_node(participant.owner)
        return participant

    def left(self, participant: MemoryParticipant) -> None:
        super().left(participant)
        presence = self._present.pop(participant.owner, None)
        if self.link is not None:
            if presence is not None:
                presence.end()
            self.link.forget_node(participant.owner)

    async def join(self) -> None:
        """Connect to the other processes. Raises :exc:`ZenohError`."""
        session = await anyio.to_thread.run_sync(self._session.open, self.options)
        link = ZenohLink(session, self.options.domain, self.registry, self.run_on_graph)
        alive = await anyio.to_thread.run_sync(self._discovery.query_tokens, link)
        info, asked = session.info, ", ".join(self.options.connect)
        met = len(info.peers_zid()) + len(info.routers_zid())
        if asked and not met:
            logger.warning("no process answers at %s yet; connecting is tried until one does", asked)
        else:
            logger.info("joined domain %d over Zenoh; connected to %d others", link.domain, met)
        self._discovery.open(link, alive)
        self.link = link
        for participant in self.participants:
            self._present[participant.owner] = link.declare_node(participant.owner)
        self._zenoh_topics.open(link)
        self._zenoh_services.open(link)

    async def leave(self) -> None:
        self.link = None
        self._discovery.close()
        self._zenoh_topics.close()
        self._zenoh_services.close()
        with anyio.CancelScope(shield=True):
            await anyio.to_thread.run_sync(self._session.close)
