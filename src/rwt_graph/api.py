"""The contract of every graph backend.

It is low-level on purpose: payloads instead of messages, callbacks instead of coroutines, so that a bridge
can pass bytes through and a backend over a network is as easy to write as one in memory. Programs use
:class:`rwt_graph.nodes.node.Node`, which is written on this contract alone.

Rules that hold for every backend:

* Everything here is synchronous and called on the graph's own thread (the event loop's, once the graph runs).
* Names are absolute and resolved (`/chatter`); see :mod:`rwt_graph.names`.
* The other side may be in another process: an answer comes through a callback, never as a return value, and
  what introspection returns is a snapshot of what is known now.
* A callback may be called before the method that took it has returned (the other side is often in the same
  process, and then it is a plain function call: `on_sample` from within `publish`, and from within
  `subscribe` for kept samples; `on_reply` from within `call_service`; goal events from within `send_goal`),
  or any time later.
* A payload that a callback is given may be a view of a receive buffer that is used again: to keep it
  after the callback has returned, keep `detach()` of it, or its `value()`.
* What a callback raises is logged, and affects no other callback.
* Every `close` and `cancel` may be called twice.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from msgspec import Struct

from rwt_participant.api import EndpointInfo as EndpointInfo
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, QoS

if TYPE_CHECKING:
    from rwt_graph.clock import Clock
    from rwt_graph.parameters.tree import ParameterTree
    from rwt_interfaces.distro import Distro
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType
    from rwt_participant.errors import CallFailed


#: Goals of one action server that may run at a time.
MOST_GOALS: Final = 1000


class Sample(Struct, frozen=True, eq=False, gc=False):
    """A payload in the graph. One is made per publish: a msgspec Struct, which costs a fifth of a dataclass.

    The payload may have come from another process undecoded; reading it raises :exc:`InvalidMessage` if it
    does not fit its type.

    Attributes:
        topic: absolute name.
        payload: the message; shared by all receivers, never changed.
        stamp_ns: the graph clock's time of publishing, nanoseconds since the epoch.
        node: absolute name of the publishing node; empty when it is not known, in another process.
        expires_ns: the clock's time until which it is delivered (lifespan); 0 for no limit.
    """

    topic: str
    payload: Payload
    stamp_ns: int
    node: str
    expires_ns: int = 0

    def detach(self) -> Sample:
        """The same sample without a view of the buffer that the payload was received in, for keeping."""
        payload = self.payload.detach()
        if payload is self.payload:
            return self
        return Sample(self.topic, payload, self.stamp_ns, self.node, self.expires_ns)


class Publisher(ABC):
    """The right to publish on one topic."""

    topic: str
    type: MessageType
    qos: QoS

    @abstractmethod
    def publish(self, payload: Payload) -> None:
        """Hand one message to every subscriber, in the order of the calls. Does nothing after `close`."""

    @property
    @abstractmethod
    def subscriber_count(self) -> int:
        """How many subscribers are known now."""

    @abstractmethod
    def close(self) -> None:
        """Leave the topic; samples kept for late joiners go with the publisher."""


class Subscription(ABC):
    """One subscriber of one topic."""

    topic: str

    @property
    @abstractmethod
    def type(self) -> MessageType | None:
        """The topic's type; None while the topic is unknown and no type was given."""

    @abstractmethod
    def history(self) -> tuple[Sample, ...]:
        """What a transient-local subscriber that joins now would receive, oldest first."""

    @abstractmethod
    def close(self) -> None:
        """Leave the topic; no callback comes after this."""


class Registration(ABC):
    """A service or an action that a node offers."""

    name: str

    @abstractmethod
    def close(self) -> None:
        """Withdraw it; calls and goals in flight end with :exc:`ProviderGone`."""


class ServiceCall(ABC):
    """One request as its provider sees it. Exactly one of `reply` and `fail` has an effect, and only once.

    Attributes:
        on_end: set by the provider; called once when the call has ended, in whatever way, so that a provider
            that keeps calls can forget one that nobody waits for any longer.
    """

    __slots__ = ("on_end",)

    service: str
    request: Payload
    on_end: Callable[[], None] | None

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether the call was answered, timed out or was abandoned by its caller."""

    @abstractmethod
    def reply(self, response: Payload) -> None:
        """Answer with success."""

    @abstractmethod
    def fail(self, reason: str) -> None:
        """Answer with failure."""


class PendingCall(ABC):
    """One request as its caller sees it."""

    __slots__ = ()

    @abstractmethod
    def cancel(self) -> None:
        """Forget the call: no reply callback comes after this."""


OnReply = Callable[["Payload | CallFailed"], None]
"""Called exactly once, unless the call is cancelled: with the response, or with why there is none."""


class ServerGoal(ABC):
    """One goal as its action server sees it.

    Attributes:
        id: 32 lower-case hex digits (a UUID).
        on_cancel: set by the server; called once when a cancel is asked for. The server then still decides.
        on_end: set by the server; called once when the goal ended without it (server closed, replaced).
    """

    id: str
    action: str
    on_cancel: Callable[[], None] | None = None
    on_end: Callable[[CallFailed], None] | None = None

    @property
    @abstractmethod
    def goal(self) -> Payload:
        """The goal's message, until the callback that is given the goal has returned.

        Raises:
            InvalidTransition: that is over; a goal may run without end, and a server keeps what it needs.
        """

    @property
    @abstractmethod
    def status(self) -> GoalStatus:
        """The state now."""

    @property
    @abstractmethod
    def cancel_requested(self) -> bool:
        """Whether a cancel was asked for."""

    @property
    def feedback_wanted(self) -> bool:
        """Whether a client takes feedback now; True in a backend that cannot know."""
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
    """The callbacks of a goal's client, in this order: accepted, feedback…, result; or only result.

    `on_result` is called exactly once: with the terminal status and the result, or with why there is none
    (rejected, no such server, server gone).
    """

    on_result: Callable[[GoalStatus, Payload | CallFailed], None]
    on_feedback: Callable[[Payload], None] | None = None
    on_accepted: Callable[[], None] | None = None


class ClientGoal(ABC):
    """One goal as its client sees it."""

    id: str
    action: str

    @property
    @abstractmethod
    def status(self) -> GoalStatus:
        """The last state that the server reported."""

    @property
    @abstractmethod
    def reason(self) -> str:
        """Why the server ended the goal as it did; empty while it runs or when nothing was said, as by
        servers of other programs in a graph over a network."""

    @abstractmethod
    def cancel(self) -> None:
        """Ask the server to cancel; the outcome comes as the result."""

    def want_feedback(self, wanted: bool) -> None:  # noqa: B027 - a backend may have no way to say so
        """Say whether feedback is of use now, which spares the server the work otherwise."""

    @abstractmethod
    def abandon(self) -> None:
        """Drop the goal's callbacks; the goal goes on running."""


class CallObserver(ABC):
    """Observes every service call and goal of a graph, for introspection. What it raises is logged."""

    @abstractmethod
    def on_call(self, service: ServiceInfo, request: Payload, on_reply: OnReply) -> OnReply:
        """Observe a call; returns what receives the answer in place of `on_reply`, and passes it on."""

    @abstractmethod
    def on_goal(self, action: ActionInfo, goal_id: str, goal: Payload, events: GoalEvents) -> GoalEvents:
        """Observe a goal; returns what receives its events in place of `events`, and passes them on."""


class Participant(ABC):
    """One node as the graph sees it: what it creates belongs to it and is closed with it.

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
            TypeConflict: the topic is established with another type.
        """

    @abstractmethod
    def subscribe(
        self,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: MessageType | None = None,
        qos: QoS = BEST_AVAILABLE,
    ) -> Subscription:
        """Become a subscriber of `topic`; kept samples of transient-local publishers come first.

        Without `type` the subscription takes the topic's type, as soon as there is one.

        Raises:
            TypeConflict: the topic is established with another type.
        """

    @abstractmethod
    def advertise_service(
        self,
        service: str,
        type: ServiceType,
        on_call: Callable[[ServiceCall], None],
    ) -> Registration:
        """Offer a service. A provider of the same name in this process is displaced: its calls in flight fail
        (SVP-07), and it answers again when this one has gone. One in another process stays, and each process
        calls its own first.
        """

    @abstractmethod
    def call_service(
        self, service: str, request: Payload, on_reply: OnReply, timeout: float | None = None
    ) -> PendingCall:
        """Call a service; an unknown service is a reply too.

        Args:
            timeout: seconds after which the reply is :exc:`CallTimeout`, kept to within 20 ms and never
                early; None waits for ever.
        """

    @abstractmethod
    def advertise_action(
        self,
        action: str,
        type: ActionType,
        on_goal: Callable[[ServerGoal], None],
    ) -> Registration:
        """Offer an action. A server of the same name in this process is displaced (ACT-18), as for
        services."""

    @abstractmethod
    def send_goal(
        self, action: str, goal: Payload, events: GoalEvents, goal_id: str | None = None
    ) -> ClientGoal:
        """Send a goal; an unknown action is a result too.

        Beyond :data:`MOST_GOALS` of one server that have not ended, further ones are rejected.

        Args:
            goal_id: 32 lower-case hex digits; None makes one. One that is in use on the action is rejected.

        Raises:
            InvalidGraphName: `goal_id` is something else.
        """

    @abstractmethod
    def cancel_goal(self, action: str, goal_id: str) -> None:
        """Ask to cancel a goal of any client by its id. An unknown id is no error (ACT-07)."""

    @abstractmethod
    def cancel_every_goal(self, action: str) -> None:
        """Ask to cancel the goals of an action, whoever sent them. An unknown action is no error."""

    @abstractmethod
    def close(self) -> None:
        """Close everything that this node created, and leave the graph.

        Its open calls and goals end with a :exc:`CallFailed` that says so; the goals go on running unheard.
        """


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic with at least one endpoint."""

    name: str
    type: MessageType | None
    publishers: tuple[EndpointInfo, ...]
    subscribers: tuple[EndpointInfo, ...]


@dataclass(frozen=True, slots=True)
class ServiceInfo:
    """One service, with the node that offers it."""

    name: str
    type: ServiceType
    node: str


@dataclass(frozen=True, slots=True)
class ActionInfo:
    """One action, with the node that offers it."""

    name: str
    type: ActionType
    node: str


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """One node and the names of what it takes part in, each sorted."""

    name: str
    publishing: tuple[str, ...]
    subscribing: tuple[str, ...]
    services: tuple[str, ...]
    actions: tuple[str, ...]


class GraphListings(ABC):
    """Topics, services and actions that are seen: those of a graph, or of a client's view of it."""

    @abstractmethod
    def topics(self) -> tuple[TopicInfo, ...]:
        """Every topic, sorted by name."""

    @abstractmethod
    def topic(self, name: str) -> TopicInfo | None:
        """One topic, or None."""

    @abstractmethod
    def services(self) -> tuple[ServiceInfo, ...]:
        """Every service, sorted by name."""

    @abstractmethod
    def service(self, name: str) -> ServiceInfo | None:
        """One service, or None."""

    @abstractmethod
    def actions(self) -> tuple[ActionInfo, ...]:
        """Every action, sorted by name."""

    @abstractmethod
    def action(self, name: str) -> ActionInfo | None:
        """One action, or None."""


class Graph(GraphListings):
    """Topics, services, actions, parameters and nodes, wherever they are.

    Attributes:
        distro: the ROS distribution whose names and messages this graph speaks.
        registry: the interfaces it knows.
        clock: ROS time, steady time and timers.
        parameters: the global tree of parameters: all of them on ROS 1; on ROS 2 those set without a node.
    """

    distro: Distro
    registry: Registry
    clock: Clock
    parameters: ParameterTree

    @abstractmethod
    def participant(self, name: str) -> Participant:
        """Join as a node of that absolute name. A second node of one name is allowed, as in ROS 2."""

    @property
    @abstractmethod
    def version(self) -> int:
        """A number that grows with every change of what is listed below, so that listings can be kept."""

    @abstractmethod
    def nodes(self) -> tuple[NodeInfo, ...]:
        """Every node, sorted by name."""

    def observe_calls(self, observer: CallObserver | None) -> bool:
        """Let `observer` observe every call and goal from now on; None ends that.

        Returns:
            Whether this backend can do that; one over a network does not see the calls of others.
        """
        return False

    @property
    @abstractmethod
    def running(self) -> bool:
        """Whether the graph is on an event loop now."""

    @abstractmethod
    def on_graph_thread(self) -> bool:
        """Whether the graph may be touched from here: this is its thread, or no loop runs it."""

    @abstractmethod
    def run_on_graph(self, call: Callable[[], None]) -> None:
        """Run `call` on the graph's thread, soon and in order; safe from any thread.

        While the graph is not running, `call` runs at once. What it raises is logged.
        """

    @abstractmethod
    def spawn(self, task: Callable[[], Awaitable[None]], name: str) -> None:
        """Run a coroutine function as a task of the graph; before the graph runs it is kept until then.

        What it raises is logged and ends nothing else; it is cancelled when the graph is left.

        Raises:
            NotRunning: the graph was left already.
        """

    @abstractmethod
    async def __aenter__(self) -> Self:
        """Run on the current event loop (asyncio or trio): timers, coroutine handlers, calls from threads."""

    @abstractmethod
    async def __aexit__(self, *exc: object) -> None:
        """Stop handlers and timers and close every participant."""
