"""Public seam for graphs with nodes in other processes: over Zenoh, ROS 2, ROS 1, or a link of your own.

A backend is a :class:`DistributedGraph`. Nodes of this process meet in its tables, as in a
:class:`~rwt_graph.MemoryGraph`; the backend adds what other processes have, and announces what this one has:

| table | this process → others | others → this process |
|---|---|---|
| `topic_table` (:class:`Topics`) | :class:`RemoteTopics` is told of each change of a :class:`Topic`; `on_publish_remote` of a :class:`MemoryPublisher` gets its samples | `remote_joined` and `remote_left` with a :class:`RemoteEndpoint`; `deliver` of each :class:`MemorySubscription` |
| `service_table` (:class:`Services`) | :class:`RemoteServices` receives what is `offered` and `withdrawn`; :class:`OfferedServices` stores it; `call` of the table carries out a call from outside | :class:`RemoteServices` finds and calls; :class:`RemoteServiceTable` keeps the providers |
| `action_table` (:class:`Actions`) | :class:`Ros2ActionServer`, as services and topics | :class:`RemoteActions`; :class:`Ros2Actions` makes them from services and topics |
| nodes | `participant` and `left` are overridden | `node_joined` and `node_left` |

Rules:

* Tables are used on the graph's thread only; `run_on_graph` leads there from every other.
* Call `changes.note()` if a remote's listing changes; the tables themselves do so.
* What belongs to a node (:class:`NodeResources`) is released when it leaves; `private` ones are not announced.
* Samples of a transient-local publisher of another process are kept in `RemoteEndpoint.cache`, while this
  process subscribes, and belong to that publisher.
* On a topic that is reserved, other processes publish nothing: subscribe there only for its
  `announced_subscribers`. Names that are not :func:`rwt_graph.names.is_printable` are left out.
* The robot displaces what clients of a server hold, here and in other processes: `remote_joined` and
  :class:`RemoteServiceTable` do so for clients of this process. A backend that
  overrides `participant` passes `for_clients` on.
* What cannot be exchanged, such as a topic of an unknown type, is reported by `problems.report`, which tells
  the clients that use it.
* What a backend cannot do, it declares in `limitations`, in one place (:class:`~rwt_graph.api.Limitation`).

`tests/contract/graph` holds the tests that all backends pass; its `harness` module says how to run them on
another one.
"""  # noqa: E501 - rows of a table

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

from rwt_graph.actions.names import belongs_to_action
from rwt_graph.actions.remote_goals import Ros2Actions
from rwt_graph.actions.server import Ros2ActionServer
from rwt_graph.api import Limitation, Network
from rwt_graph.memory.actions import Actions, MemoryActionServer, NotifyingGoal, RemoteActions
from rwt_graph.memory.endpoint_types import EndpointTypes
from rwt_graph.memory.graph import MemoryGraph, MemoryParticipant
from rwt_graph.memory.remote_services import RemoteServiceTable
from rwt_graph.memory.services import (
    MemoryCall,
    MemoryProvider,
    OfferedServices,
    RemoteServices,
    Services,
)
from rwt_graph.memory.tables import Changes, NodeResources, PerNode
from rwt_graph.memory.topics import (
    KEEP_ALL_LIMIT,
    MemoryPublisher,
    MemorySubscription,
    RemoteEndpoint,
    RemoteTopics,
    Topic,
    Topics,
    TransientLocalCache,
    received_sample,
)
from rwt_graph.nodes.actionlib import STATUS, ActionlibStatus
from rwt_graph.parameters.tree import ParameterTree

__all__ = [
    "DistributedGraph",
    "Limitation",
    "Network",
    "MemoryParticipant",
    "NodeResources",
    "PerNode",
    "Changes",
    "Topics",
    "Topic",
    "MemoryPublisher",
    "MemorySubscription",
    "RemoteTopics",
    "RemoteEndpoint",
    "received_sample",
    "EndpointTypes",
    "TransientLocalCache",
    "KEEP_ALL_LIMIT",
    "Services",
    "MemoryProvider",
    "MemoryCall",
    "OfferedServices",
    "RemoteServices",
    "RemoteServiceTable",
    "Actions",
    "MemoryActionServer",
    "NotifyingGoal",
    "RemoteActions",
    "Ros2Actions",
    "Ros2ActionServer",
    "belongs_to_action",
    "ActionlibStatus",
    "STATUS",
    "ParameterTree",
]


class DistributedGraph(MemoryGraph):
    """Base of a graph with nodes in this process and in others.

    Its nodes can be used before it is entered. Entering it calls :meth:`join`; leaving it closes the nodes of
    this process, then calls :meth:`leave`.

    Attributes:
        limitations: what the backend cannot do.
    """

    def set_remotes(self, topics: RemoteTopics, services: RemoteServices, actions: RemoteActions) -> None:
        """Connect the tables with those of other processes; called by the constructor of a backend."""
        self.topic_table.remote = topics
        self.service_table.remote = services
        self.action_table.remote = actions

    @property
    def participants(self) -> Sequence[MemoryParticipant]:
        """Return the nodes of this process, in the order in which they were made."""
        return tuple(self._participants)

    @property
    def remote_nodes(self) -> int:
        """Number of nodes in other processes."""
        return self._nodes.total() - len(self._participants)

    def offer_action_services(
        self, participant: MemoryParticipant, server: MemoryActionServer
    ) -> Callable[[], None]:
        return Ros2ActionServer(participant, server, self.action_table, self.clock).close

    @abstractmethod
    async def join(self) -> None:
        """Connect to other processes, and announce the nodes that exist. Raises the backend's error."""

    @abstractmethod
    async def leave(self) -> None:
        """Disconnect. Also called if :meth:`join` has failed or was cancelled."""

    async def _join(self) -> None:
        await self.join()

    async def __aexit__(self, *exc: object) -> None:
        try:
            self._close_participants()
        finally:
            try:
                await self.leave()
            finally:
                await super().__aexit__(*exc)
