"""What lies beyond this process, as the tables of a graph see it.

A graph in memory has nothing there. A backend over a network gives each of its tables one of these, and puts
what it hears of into :class:`~rwt_graph.memory.topics.Topics` itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rwt_graph.api import ActionInfo, ClientGoal, GoalEvents, OnReply, PendingCall, ServiceInfo
    from rwt_graph.memory.node_resources import Owner
    from rwt_graph.memory.services import MemoryProvider
    from rwt_graph.memory.topics import Kept, Topic
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import MessageType
    from rwt_program.goals import GoalStatus
    from rwt_program.qos import QoS


@dataclass(eq=False, slots=True)
class RemoteEndpoint:
    """A publisher or subscription in another process.

    Attributes:
        node: absolute name of its node.
        type_name: as the distribution writes it.
        type: None when the registry does not know that type.
        kept: what a transient-local publisher's samples are kept in here, while this process subscribes.
    """

    node: str
    type_name: str
    type: MessageType | None
    qos: QoS
    kept: Kept | None = field(default=None)


class TopicsElsewhere(Protocol):
    """Follows the topics of this process."""

    def changed(self, topic: Topic) -> None:
        """An endpoint of this process joined or left, or the topic's type is another one."""
        ...


class ServicesElsewhere(Protocol):
    """The services of other processes, and who tells them of ours."""

    def offered(self, provider: MemoryProvider) -> None:
        """A service is offered here."""
        ...

    def withdrawn(self, provider: MemoryProvider) -> None:
        """It is not any more; its open calls have not ended yet."""
        ...

    def info(self, name: str) -> ServiceInfo | None:
        """One service of another process, or None."""
        ...

    def names(self) -> set[str]:
        """The names of all of them."""
        ...

    def of_node(self, node: str) -> set[str]:
        """The names of those that a node offers."""
        ...

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: Owner
    ) -> PendingCall | None:
        """Call one; None when no other process offers it."""
        ...


class ActionsElsewhere(Protocol):
    """The actions of other processes."""

    def info(self, name: str) -> ActionInfo | None:
        """One action of another process, or None."""
        ...

    def names(self) -> set[str]:
        """The names of all of them."""
        ...

    def of_node(self, node: str) -> set[str]:
        """The names of those that a node offers."""
        ...

    def send(
        self, action: str, payload: Payload, events: GoalEvents, goal_id: str, client: Owner
    ) -> ClientGoal | None:
        """Send a goal; None when no other process offers the action."""
        ...

    def cancel(self, action: str, goal_id: str, client: Owner) -> None:
        """Ask to cancel a goal by its id."""
        ...


class GoalWatcher(Protocol):
    """Follows the goals of one action server of this process."""

    @property
    def feedback_wanted(self) -> bool:
        """Whether feedback is of use to anybody now."""
        ...

    def changed(self, goal_id: str) -> None:
        """Its state is another one."""
        ...

    def fed_back(self, goal_id: str, feedback: Payload) -> None:
        """Its server sent feedback."""
        ...

    def ended(self, goal_id: str, status: GoalStatus, result: Payload | None, reason: str) -> None:
        """It ended; without a result when it was rejected or its server went away."""
        ...


class Carrier(Protocol):
    """What makes an action server's goals known beyond this process."""

    def close(self) -> None:
        """Make nothing known any more."""
        ...


__all__ = [
    "Carrier",
    "ActionsElsewhere",
    "GoalWatcher",
    "RemoteEndpoint",
    "ServicesElsewhere",
    "TopicsElsewhere",
]
