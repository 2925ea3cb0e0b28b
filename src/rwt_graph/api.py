"""Contract of every graph backend.

It is low-level: payloads instead of messages, and callbacks instead of coroutines. A bridge can thus pass
bytes through, and a backend over a network is as easy to write as one in memory. Programs use
:class:`rwt_graph.nodes.node.Node`, which depends on this contract only.

Rules for every backend:

* Everything here is synchronous, and called on the graph's own thread (the event loop's, once the graph
  runs).
* Names are absolute and resolved (`/chatter`); see :mod:`rwt_graph.names`.
* The other side may be in another process: answers arrive through callbacks, never as return values, and
  introspection returns a snapshot of what is known now.
* A callback may be called before the method that took it has returned: `on_sample` within `publish`, and
  within `subscribe` for retained samples; `on_reply` within `call_service`; goal events within `send_goal`.
* The payload passed to a callback may be a view of a receive buffer that is reused: to keep it after the
  callback has returned, keep its `detach()` or `value()`.
* Exceptions of a callback are logged, and affect no other callback.
* `close` and `cancel` are idempotent.
* The robot comes before the clients of a server. A server acts for its clients as nodes of its own
  (`for_clients`). What these hold is held against other such nodes only: an endpoint of the robot, in this
  process or another, takes the type of its topic, and the name of its service or action. What is in its way
  is displaced: closed, with the reason (`on_displaced`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self, TypeAlias

from msgspec import Struct

from rwt_graph.problems import Problems
from rwt_participant.api import EndpointInfo as EndpointInfo
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, QoS
from rwt_participant.threads.pool import HandlerThreads

if TYPE_CHECKING:
    from rwt_graph.clock import Clock
    from rwt_graph.parameters.tree import ParameterTree
    from rwt_interfaces.distro import Distro
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType
    from rwt_participant.errors import CallFailed


OnConnection: TypeAlias = Callable[[str, bool], None]
"""Called with a text for clients, and False if the connection is lost, True if it is restored."""

#: Maximum number of concurrent goals of one action server.
MOST_GOALS: Final = 1000


class Limitation(Enum):
    """Limitation of a backend, as a sentence; declared in :attr:`Graph.limitations`."""

    SERVICE_ERRORS = "A caller in another process gets no answer from a service that fails."
    CALL_END = "A service is not informed that a caller in another process waits no longer."
    GOAL_REASONS = "The reason why a goal was rejected in another process may be missing."
    LIFESPAN = "The lifespan of samples of other processes is measured in real time."
    SUBSCRIBER_COUNT = "The subscribers of one topic in another process count as one."
    QOS = "Other processes do not report QoS, except for latched publishers."
    PARAMETER_TREE = "The global tree of parameters stays in the process."


@dataclass(frozen=True, slots=True)
class Network:
    """Connection of a graph to programs in other processes, for its operator.

    Attributes:
        name: such as ``ROS 2 kilted``.
        details: settings that the other programs must share.
        nodes: number of nodes in other processes.
        advice: what to check if there are none.
    """

    name: str
    details: str
    nodes: int
    advice: str


class Sample(Struct, frozen=True, eq=False, gc=False):
    """Payload in the graph. A msgspec Struct for speed: one is made per publish.

    The payload may have come from another process undecoded; reading it raises :exc:`InvalidMessage` if it
    does not fit its type.

    Attributes:
        topic: absolute name.
        payload: message; shared by all receivers and immutable.
        stamp_ns: time of publishing on the graph's clock, nanoseconds since the epoch.
        node: absolute name of the publishing node; empty if unknown, in another process.
        expires_ns: time on the clock until which it is delivered (lifespan); 0 for no limit.
    """

    topic: str
    payload: Payload
    stamp_ns: int
    node: str
    expires_ns: int = 0

    def detach(self) -> Sample:
        """Return the sample for keeping, without a view of a receive buffer."""
        payload = self.payload.detach()
        if payload is self.payload:
            return self
        return Sample(self.topic, payload, self.stamp_ns, self.node, self.expires_ns)


OnDisplaced: TypeAlias = Callable[[str], None]
"""Called once with a text for clients, after an endpoint of a node for clients was closed for the robot."""


class Publisher(ABC):
    """Publisher of one topic.

    Attributes:
        on_displaced: called if the robot uses the topic with another type. Nodes for clients set it; an
            endpoint of another node for which it is set is displaced, too.
    """

    topic: str
    type: MessageType
    qos: QoS
    on_displaced: OnDisplaced | None = None

    @property
    def is_closed(self) -> bool:
        """True once it has left the topic."""
        return False

    @abstractmethod
    def publish(self, payload: Payload) -> None:
        """Send a message to every subscriber, in the order of the calls. No-op after `close`."""

    @property
    @abstractmethod
    def subscriber_count(self) -> int:
        """Number of known subscribers."""

    @abstractmethod
    def close(self) -> None:
        """Leave the topic, with the samples that are retained for late joiners."""


class Subscription(ABC):
    """Subscriber of one topic.

    Attributes:
        on_displaced: called if the robot uses the topic with another type. Nodes for clients set it; an
            endpoint of another node for which it is set is displaced, too.
    """

    topic: str
    on_displaced: OnDisplaced | None = None

    @property
    @abstractmethod
    def type(self) -> MessageType | None:
        """Type of the topic; None while the topic is unknown and no type was given."""

    @abstractmethod
    def history(self) -> tuple[Sample, ...]:
        """Samples that a transient-local subscriber would receive now, oldest first."""

    @abstractmethod
    def close(self) -> None:
        """Leave the topic; no callback is called after this."""


class Registration(ABC):
    """Service or action that a node offers.

    Attributes:
        on_displaced: set by a node for clients; called if the robot offers the same name.
    """

    name: str
    on_displaced: OnDisplaced | None = None

    @abstractmethod
    def close(self) -> None:
        """Withdraw it; pending calls and goals end with :exc:`ProviderGone`."""


class ServiceCall(ABC):
    """Request as its provider sees it. Only the first call of `reply` or `fail` has an effect.

    Attributes:
        on_end: set by the provider; called once when the call has ended in any way, so that a provider that
            keeps calls can drop it.
    """

    __slots__ = ("on_end",)

    service: str
    request: Payload
    on_end: Callable[[], None] | None

    @property
    @abstractmethod
    def done(self) -> bool:
        """True if the call was answered, timed out or was abandoned by its caller."""

    @abstractmethod
    def reply(self, response: Payload) -> None:
        """Answer with success."""

    @abstractmethod
    def fail(self, reason: str) -> None:
        """Answer with failure."""


class PendingCall(ABC):
    """Request as its caller sees it."""

    __slots__ = ()

    @abstractmethod
    def cancel(self) -> None:
        """Cancel the call: no reply callback is called after this."""


OnReply = Callable[["Payload | CallFailed"], None]
"""Called with the response or an error, exactly once unless the call is cancelled."""


class ServerGoal(ABC):
    """Goal as its action server sees it.

    Attributes:
        id: 32 lower-case hex digits (a UUID).
        on_cancel: set by the server; called once when a cancel is requested. The server decides on it.
        on_end: set by the server; called once when the goal ended without it (server closed, replaced).
    """

    id: str
    action: str
    on_cancel: Callable[[], None] | None = None
    on_end: Callable[[CallFailed], None] | None = None

    @property
    @abstractmethod
    def goal(self) -> Payload:
        """Message of the goal, until the callback that received the goal has returned.

        Raises:
            InvalidTransition: the callback has returned; a server keeps a copy of what it needs.
        """

    @property
    @abstractmethod
    def status(self) -> GoalStatus:
        """Current state."""

    @property
    @abstractmethod
    def cancel_requested(self) -> bool:
        """True if a cancel was requested."""

    @property
    def feedback_wanted(self) -> bool:
        """True if a client takes feedback now, or if the backend cannot know."""
        return True

    @abstractmethod
    def accept(self) -> None:
        """UNKNOWN → ACCEPTED → EXECUTING."""

    @abstractmethod
    def reject(self, reason: str) -> None:
        """End an UNKNOWN goal; the client receives :exc:`GoalRejected`."""

    @abstractmethod
    def feedback(self, feedback: Payload) -> None:
        """Send feedback. Ignored once the goal has ended."""

    @abstractmethod
    def finish(self, status: GoalStatus, result: Payload, reason: str = "") -> None:
        """End the goal as SUCCEEDED, CANCELED or ABORTED.

        Raises:
            InvalidTransition: the state machine does not allow it.
        """


@dataclass(frozen=True, slots=True)
class GoalEvents:
    """Callbacks of a goal's client, in this order: accepted, feedback…, result; or only result.

    `on_result` is called exactly once: with the terminal status and the result, or with an error (rejected,
    unknown action, server gone).
    """

    on_result: Callable[[GoalStatus, Payload | CallFailed], None]
    on_feedback: Callable[[Payload], None] | None = None
    on_accepted: Callable[[], None] | None = None


class ClientGoal(ABC):
    """Goal as its client sees it."""

    id: str
    action: str

    @property
    @abstractmethod
    def status(self) -> GoalStatus:
        """Last state that the server reported."""

    @property
    @abstractmethod
    def reason(self) -> str:
        """Reason that the server gave for the end; empty while it runs or if there is none."""

    @abstractmethod
    def cancel(self) -> None:
        """Request cancellation; the outcome is the result."""

    def want_feedback(self, wanted: bool) -> None:  # noqa: B027 - optional for backends
        """Set whether feedback is wanted now, which saves the server work if not."""

    @abstractmethod
    def abandon(self) -> None:
        """Drop the goal's callbacks; the goal goes on running."""


class CallObserver(ABC):
    """Observer of all service calls and goals of a graph, for introspection. Its exceptions are logged."""

    @abstractmethod
    def on_call(self, service: ServiceInfo, request: Payload, on_reply: OnReply) -> OnReply:
        """Observe a call; return a callback that replaces `on_reply` and passes the answer on."""

    @abstractmethod
    def on_goal(self, action: ActionInfo, goal_id: str, goal: Payload, events: GoalEvents) -> GoalEvents:
        """Observe a goal; return callbacks that replace `events` and pass them on."""


class Participant(ABC):
    """Node as the graph sees it. Owns what it creates, and closes it when it leaves.

    Attributes:
        name: absolute name of the node.
    """

    name: str

    @abstractmethod
    def advertise(
        self,
        topic: str,
        type: MessageType,
        qos: QoS = DEFAULT_QOS,
    ) -> Publisher:
        """Become a publisher of `topic`.

        Raises:
            TypeConflict: the topic is established with another type, not only by nodes for clients.
        """

    @abstractmethod
    def subscribe(
        self,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: MessageType | None = None,
        qos: QoS = BEST_AVAILABLE,
    ) -> Subscription:
        """Become a subscriber of `topic`; retained samples of transient-local publishers come first.

        Without `type` the subscription takes the topic's type, as soon as there is one.

        Raises:
            TypeConflict: the topic is established with another type, not only by nodes for clients.
        """

    @abstractmethod
    def advertise_service(
        self,
        service: str,
        type: ServiceType,
        on_call: Callable[[ServiceCall], None],
    ) -> Registration:
        """Offer a service.

        A provider of the same name in this process is replaced until this one closes; its pending calls fail
        (SVP-07). A provider in another process is not replaced: each process calls its own first. A provider
        of a node for clients is displaced by a later one of the robot, in this process or another.
        """

    @abstractmethod
    def call_service(
        self, service: str, request: Payload, on_reply: OnReply, timeout: float | None = None
    ) -> PendingCall:
        """Call a service; an unknown one is reported through `on_reply`.

        Args:
            timeout: seconds after which the reply is :exc:`CallTimeout`, at most 20 ms late and never early;
                None waits without limit.
        """

    @abstractmethod
    def advertise_action(
        self,
        action: str,
        type: ActionType,
        on_goal: Callable[[ServerGoal], None],
    ) -> Registration:
        """Offer an action. Replaces a server of the same name in this process (ACT-18), as for services."""

    @abstractmethod
    def send_goal(
        self, action: str, goal: Payload, events: GoalEvents, goal_id: str | None = None
    ) -> ClientGoal:
        """Send a goal; an unknown action is reported through `events`.

        Goals of a server beyond :data:`MOST_GOALS` are rejected.

        Args:
            goal_id: 32 lower-case hex digits; generated by default. One that is in use on the action is
                rejected.

        Raises:
            InvalidGraphName: `goal_id` has another form.
        """

    @abstractmethod
    def cancel_goal(self, action: str, goal_id: str) -> None:
        """Request cancellation of any client's goal by its id; no-op for an unknown id (ACT-07)."""

    @abstractmethod
    def cancel_every_goal(self, action: str) -> Iterator[None]:
        """Request cancellation of all present goals of an action; no-op for an unknown action.

        Returns:
            Steps that the caller has to take: each cancels one goal, the oldest first.
        """

    @abstractmethod
    def close(self) -> None:
        """Close everything that this node created, and leave the graph.

        Its pending calls and goals end with :exc:`CallFailed`; the goals continue on their servers.
        """


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """Topic with at least one endpoint."""

    name: str
    type: MessageType | None
    publishers: tuple[EndpointInfo, ...]
    subscribers: tuple[EndpointInfo, ...]


@dataclass(frozen=True, slots=True)
class ServiceInfo:
    """Service, with the node that offers it."""

    name: str
    type: ServiceType
    node: str


@dataclass(frozen=True, slots=True)
class ActionInfo:
    """Action, with the node that offers it."""

    name: str
    type: ActionType
    node: str


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """Node with the names of its endpoints, each list sorted."""

    name: str
    publishing: tuple[str, ...]
    subscribing: tuple[str, ...]
    services: tuple[str, ...]
    actions: tuple[str, ...]


class GraphListings(ABC):
    """Visible topics, services and actions of a graph, or of a client's view of it."""

    @abstractmethod
    def topics(self) -> tuple[TopicInfo, ...]:
        """Return all topics, sorted by name."""

    @abstractmethod
    def topic(self, name: str) -> TopicInfo | None:
        """Return a topic; None if it does not exist."""

    @abstractmethod
    def services(self) -> tuple[ServiceInfo, ...]:
        """Return all services, sorted by name."""

    @abstractmethod
    def service(self, name: str) -> ServiceInfo | None:
        """Return a service; None if it does not exist."""

    @abstractmethod
    def actions(self) -> tuple[ActionInfo, ...]:
        """Return all actions, sorted by name."""

    @abstractmethod
    def action(self, name: str) -> ActionInfo | None:
        """Return an action; None if it does not exist."""


class Graph(GraphListings):
    """Topics, services, actions, parameters and nodes, in one process or several.

    Attributes:
        distro: ROS distribution of the names and messages.
        registry: known interfaces.
        clock: ROS time, steady time and timers.
        parameters: global tree of parameters: all of them on ROS 1; on ROS 2 those set without a node.
        limitations: what the backend cannot do.
        dds_rules: True if publishers and subscriptions with incompatible QoS are not connected.
        in_batch: calls a function that delivers what other processes sent; servers send the results at once.
        may_retain: returns True if a backend may retain samples of a volatile publisher of a topic, for
            subscribers in other processes that request it.
        observers: called when the connection to other processes is lost or restored, by backends that
            notice it.
    """

    limitations: frozenset[Limitation] = frozenset()
    dds_rules: bool = False
    in_batch: Callable[[Callable[[], None]], None] = staticmethod(lambda call: call())
    may_retain: Callable[[str], bool] = staticmethod(lambda topic: True)
    distro: Distro
    registry: Registry
    clock: Clock
    parameters: ParameterTree

    @property
    def network(self) -> Network | None:
        """Connection to other processes; None without one."""
        return None

    @cached_property
    def observers(self) -> set[OnConnection]:
        return set()

    @cached_property
    def handler_threads(self) -> HandlerThreads:
        """Threads for the handlers of its nodes that block (`threaded=True`)."""
        return HandlerThreads()

    @cached_property
    def problems(self) -> Problems:
        """Reasons why topics and services of other processes cannot be used, as far as the backend knows."""
        return Problems()

    @abstractmethod
    def participant(self, name: str, *, for_clients: bool = False) -> Participant:
        """Join as a node with that absolute name. Several nodes may have the same name, as in ROS 2.

        Args:
            for_clients: True for a node as which a server acts for its clients: the robot displaces what it
                holds. In other processes, such nodes are known by :func:`rwt_graph.names.is_for_clients`.
        """

    @abstractmethod
    def reserve(self, names: Iterable[str]) -> None:
        """Reserve names of topics and services for the nodes of this process.

        Other processes receive what is published on such a topic. What they publish there is ignored, and the
        services are not offered to them.
        """

    @abstractmethod
    def is_reserved(self, name: str) -> bool:
        """Return True if a name is reserved, see :meth:`reserve`."""

    @property
    @abstractmethod
    def version(self) -> int:
        """Number that grows with every change of the listings, so that they can be cached."""

    def count_services(self, name: str) -> int:
        """Return the number of known providers of a service."""
        return int(self.service(name) is not None)

    @abstractmethod
    def nodes(self) -> tuple[NodeInfo, ...]:
        """Return all nodes, sorted by name."""

    def topic_names(self) -> Sequence[str]:
        """Return the names of all topics, unsorted; some backends do so faster than :meth:`topics`."""
        return tuple(topic.name for topic in self.topics())

    def action_names(self) -> Sequence[str]:
        """Return the names of all actions, unsorted; some backends do so faster than :meth:`actions`."""
        return tuple(action.name for action in self.actions())

    def observe_calls(self, observer: CallObserver | None) -> bool:
        """Let `observer` observe every call and goal from now on; None ends that.

        Returns:
            True if the backend supports it; one over a network does not see the calls of others.
        """
        return False

    @property
    @abstractmethod
    def running(self) -> bool:
        """True if the graph is on an event loop now."""

    @abstractmethod
    def on_graph_thread(self) -> bool:
        """True if this is the graph's thread, or no loop runs the graph."""

    @abstractmethod
    def run_on_graph(self, call: Callable[[], None]) -> None:
        """Run `call` on the graph's thread, soon and in order; safe from any thread.

        While the graph is not running, `call` runs at once. Its exceptions are logged.
        """

    def soon(self, call: Callable[[], None]) -> None:
        """Run `call` on the graph's thread: at once there, soon from elsewhere."""
        if self.on_graph_thread():
            call()
        else:
            self.run_on_graph(call)

    @abstractmethod
    def spawn(self, task: Callable[[], Awaitable[None]], name: str) -> None:
        """Run a coroutine function as a task of the graph; it starts when the graph runs.

        Its exceptions are logged; it is cancelled when the graph is left.

        Raises:
            NotRunning: the graph was left already.
        """

    @abstractmethod
    async def __aenter__(self) -> Self:
        """Run on the current event loop (asyncio or trio): timers, coroutine handlers, calls from threads."""

    @abstractmethod
    async def __aexit__(self, *exc: object) -> None:
        """Stop handlers and timers and close every participant."""
