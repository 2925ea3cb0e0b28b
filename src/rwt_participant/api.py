"""Contract of a robot program, which is the same for a node of the graph and for a client of a server.

Verbs that return at once are plain functions: `advertise`, `publish`, `subscribe`, `topic`,
`advertise_service`, `advertise_action`, `cancel_goal`, `create_timer`. Verbs that wait for an answer are
coroutines: `call`, `once`, `send_goal`, listings, parameters, transforms. A forgotten `await` is therefore
noticed: its answer is missing.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

from rwt_participant.future import USUAL, Timeout
from rwt_participant.goals import BlockingExecute, Execute, Goal
from rwt_participant.handles import Handle, Publisher, Subscription
from rwt_participant.messages import (
    Message,
    MessageCallback,
    MessageLike,
    ParameterValue,
    RawCallback,
    ServiceHandler,
)
from rwt_participant.qos import QoS
from rwt_participant.timers import PeriodicTimer, RobotClock

if TYPE_CHECKING:
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType
    from rwt_participant.transforms import Transforms


SERVICE_EVENTS: Final = "/_service_event"
"""Suffix of the topic on which ROS 2's service introspection publishes the calls of a service."""

ACTION_PARTS: Final = "/_action/"
"""Separator between an action's name and those of the topics and services that carry it on ROS 2."""


@dataclass(frozen=True, slots=True)
class EndpointInfo:
    """One publisher or subscriber of a topic."""

    node: str
    type: str
    qos: QoS


@dataclass(frozen=True, slots=True)
class Listed:
    """Topic, service or action in a listing of a robot.

    Attributes:
        name: absolute name.
        type: type name, as the robot's distribution spells it; empty while unknown.
        publishers: publishers of a topic; None if the robot does not list them.
        subscribers: subscribers of a topic; None if the robot does not list them.
    """

    name: str
    type: str = ""
    publishers: tuple[EndpointInfo, ...] | None = None
    subscribers: tuple[EndpointInfo, ...] | None = None


class Parameters(Protocol):
    """Parameters of all nodes: `/node:name` on ROS 2, `/name` on ROS 1 (API-08).

    A name without a node is one of the global tree, which also exists on ROS 2, for ROS 1 programs.
    """

    async def get(self, name: str, default: ParameterValue = None) -> ParameterValue:
        """Return the value of a parameter.

        Args:
            default: value to return if the parameter does not exist; None raises instead.

        Raises:
            NotFound: the parameter or its node does not exist, and no default is given.
            CallFailed: the node, or the robot, did not answer.
        """

    async def set(self, name: str, value: ParameterValue) -> None:
        """Set a parameter; returns once its node has accepted the value.

        Raises:
            ParameterRejected: the node rejects the value, or has no such parameter; with the reason.
            CallFailed: the node did not answer.
        """

    async def has(self, name: str) -> bool:
        """Return True if the parameter exists and has a value. Raises :exc:`CallFailed`."""

    async def delete(self, name: str) -> None:
        """Remove a parameter.

        Raises:
            NotFound: the parameter or its node does not exist.
            ParameterRejected: the node does not allow it.
            CallFailed: the node did not answer.
        """

    async def names(self) -> tuple[str, ...]:
        """Return the full names of all parameters, sorted. Raises :exc:`CallFailed`."""


class RobotApi(Protocol):
    """Robot as a program uses it; implemented by :class:`rwt_graph.Node` and :class:`rwt_client.Robot`.

    In addition to the errors of each verb, a node raises :exc:`~rwt_graph.InvalidGraphName` for a name that
    ROS does not allow, and :exc:`~rwt_graph.TypeConflict` for a topic that is established with another type.
    A client raises :exc:`~rwt_client.NotConnected` if a message or a goal cannot be sent.

    Attributes:
        params: parameters of all nodes.
    """

    params: Parameters

    @property
    def tf(self) -> Transforms:
        """Transforms between frames; subscribes to `/tf` and `/tf_static` with the first query."""

    @property
    def clock(self) -> RobotClock:
        """Clock of timers and timeouts: that of a node's graph, or of a client's computer."""

    # -- listings --------------------------------------------------------------------------------------------

    async def topics(self, *, hidden: bool = False) -> tuple[Listed, ...]:
        """Return the topics, sorted by name.

        Args:
            hidden: include the topics of service introspection and of actions, which ROS 2's own listings
                leave out; a client asks for each of them by name. A node always lists them.

        Raises:
            CallFailed: of a client: the robot does not answer.
        """

    async def services(self) -> tuple[Listed, ...]:
        """Return the services, sorted by name. Raises :exc:`CallFailed`."""

    async def actions(self) -> tuple[Listed, ...]:
        """Return the actions, sorted by name. Raises :exc:`CallFailed`."""

    async def type_of(self, topic: str) -> MessageType:
        """Return the type of a topic.

        Raises:
            NotFound: the topic does not exist, or has no type yet.
            UnknownType: its definition is not available.
        """

    async def interface(self, name: str) -> MessageType | ServiceType | ActionType:
        """Return the message, service or action type of that name; a message wins over a service.

        Raises:
            UnknownType: there is no such type.
        """

    # -- topics ----------------------------------------------------------------------------------------------

    def advertise(self, topic: str, type: str, *, qos: QoS | None = None, latch: bool = False) -> Publisher:
        """Become a publisher of a topic.

        Args:
            type: `std_msgs/String` or `std_msgs/msg/String`.
            qos: keep-last 10, reliable, volatile by default.
            latch: retain the last message for late joiners; the same as `qos=LATCHED`.

        Raises:
            UnknownType: there is no such message; of a client, from the first `publish`, or when awaited.
        """

    def publish(
        self, topic: str, message: MessageLike, type: str | None = None, *, latch: bool = False
    ) -> Publisher:
        """Publish one message. The first one advertises the topic, which stays advertised.

        Args:
            message: a :data:`~rwt_participant.messages.MessageLike`.
            type: None uses the type of the message's class, or the topic's own.
            latch: retain the last message for late joiners; effective with the first message.

        Raises:
            InvalidMessage: the message does not fit the type; of a client, when awaited, if it must ask the
                robot for the type first.
            UnknownType: there is no such message; of a client, when awaited.
            NotFound: no type is given and the topic has none; of a client, when awaited.
        """

    def subscribe(
        self,
        topic: str,
        callback: MessageCallback,
        type: str | None = None,
        *,
        qos: QoS | None = None,
        queue_size: int = ...,
        queue_bytes: int = ...,
        threaded: bool = False,
    ) -> Handle:
        """Call `callback` with each message of a topic.

        Args:
            callback: a plain function is called at once, on the thread of the graph or the connection, and
                should be fast. A coroutine function is called in one task, with one message after the other;
                meanwhile the newest `queue_size` messages are queued, up to `queue_bytes` together. The
                newest is queued whatever its size.
            type: None uses the topic's own: a node takes it as soon as the topic has one; a client asks the
                robot, which must know the topic.
            qos: by default whatever the publishers offer.
            threaded: True runs a plain function in a thread, so that it may block, with one message after the
                other as for a coroutine function. The threads are those of a bounded pool.

        Raises:
            UnknownType: there is no such message; of a client, when awaited.
            NotFound: of a client, when awaited: no type is given, and the topic does not exist.
            TypeError: `threaded`, and `callback` is a coroutine function.
        """

    def subscribe_raw(self, topic: str, callback: RawCallback, type: str | None = None) -> Handle:
        """Call `callback` with each message of a topic as the robot serialises it, without decoding it.

        For programs that keep messages or pass them on.

        Args:
            callback: plain function, called at once.
            type: as for :meth:`subscribe`. Without one, a node's subscription follows the topic if its type
                changes.

        Raises:
            UnknownType, NotFound: as for :meth:`subscribe`.
        """

    def topic(
        self,
        topic: str,
        type: str | None = None,
        *,
        qos: QoS | None = None,
        queue_size: int = ...,
        queue_bytes: int = ...,
    ) -> Subscription:
        """Return the messages of a topic from now on, as an asynchronous iterator; as :meth:`subscribe`."""

    async def once(self, topic: str, type: str | None = None, *, timeout: Timeout = USUAL) -> Message:
        """Return the next message of a topic, or the one that it retains for late joiners.

        Raises:
            TimedOut: none arrived in time.
            UnknownType: there is no such message.
            NotFound: of a client: no type is given, and the topic does not exist.
        """

    # -- services --------------------------------------------------------------------------------------------

    async def call(
        self,
        service: str,
        request: MessageLike | None = None,
        type: str | None = None,
        *,
        timeout: Timeout = USUAL,
    ) -> Message:
        """Call a service and wait for its response.

        Args:
            request: None for a request of defaults.
            type: service type. None asks the robot, once per service; a node checks the request against the
                service's own type in any case.
            timeout: seconds; None waits without limit. By default that of the node or the connection.

        Returns:
            Response, an instance of its class.

        Raises:
            ProviderNotFound: the service does not exist (a :exc:`CallFailed` and a :exc:`NotFound`).
            ServiceFailed: the provider reports failure; with its text.
            CallTimeout: there was no answer in time.
            CallFailed: base of these and of any other failure: ProviderGone, ConnectionLost.
            InvalidMessage: the request or the response does not fit the service's type.
            UnknownType: there is no such service type.
        """

    def advertise_service(
        self, service: str, type: str, handler: ServiceHandler, *, threaded: bool = False
    ) -> Handle:
        """Offer a service; replaces a provider of the same name in this program.

        Args:
            handler: takes the request and returns the response: a
                :data:`~rwt_participant.messages.MessageLike`, or None for a response of defaults. Raises
                :exc:`~rwt_participant.errors.ServiceFailed` to tell the caller the reason of a failure; any
                other exception is logged, and fails the call as well. A plain function runs on the thread of
                the graph or the connection; use a coroutine function for slow work, or `threaded` for code
                that blocks. Calls may overlap.
            threaded: True runs a plain function in a thread of a bounded pool.

        Raises:
            UnknownType: there is no such service type; of a client, when awaited.
            TypeError: `handler` is not a function, or a coroutine function with `threaded`.
        """

    # -- actions ---------------------------------------------------------------------------------------------

    async def send_goal(
        self,
        action: str,
        goal: MessageLike | None = None,
        type: str | None = None,
        *,
        on_feedback: Callable[[Message], object] | None = None,
    ) -> Goal:
        """Send a goal to an action.

        Args:
            goal: None for a goal of defaults.
            type: action type; None asks the robot.
            on_feedback: plain function, called with each feedback; without it, iterate over the goal.

        Raises:
            ProviderNotFound: the action does not exist; raised by the goal's `result` if the robot does not
                report it at once.
            GoalRejected: the action server rejects the goal; raised by `result` likewise.
            ProviderGone: of a node: the action server has left meanwhile.
            InvalidMessage: the goal does not fit the action's type.
            UnknownType: there is no such action type.
        """

    def cancel_goal(self, action: str, goal_id: str) -> None:
        """Request the cancellation of a goal of any sender, by its id; an unknown one is ignored."""

    def advertise_action(
        self, action: str, type: str, execute: Execute | BlockingExecute, *, threaded: bool = False
    ) -> Handle:
        """Offer an action; replaces a server of the same name in this program.

        Args:
            execute: coroutine function that works on one goal and returns its result. Goals run
                concurrently, each in a task. It raises GoalCanceled or GoalAborted to end a goal other than
                by success; any other exception aborts it. Cancelled when the action is withdrawn.
            threaded: True runs a plain function in a thread of a bounded pool; it has the same goal, whose
                methods work there. `cancel_requested` is also true when the action is withdrawn.

        Raises:
            UnknownType: there is no such action type; of a client, when awaited.
            TypeError: `execute` is not a coroutine function; with `threaded`, not a plain function.
        """

    # -- description -----------------------------------------------------------------------------------------

    def describe(self, urdf: str, *, frame_prefix: str = "", publish_frequency: float = 100.0) -> Handle:
        """Publish the robot's description, and the transforms of its links from `joint_states`.

        `robot_description` is latched. Transforms of fixed joints are published once on `/tf_static`; those
        of the joints of each joint state on `/tf`, with its stamp, and so are those of joints that mimic
        them. Joints that the description does not have are ignored.

        Closing the handle ends this. Transforms on `/tf_static`, and the parameter `robot_description` of a
        node, stay.

        Args:
            urdf: description as XML. Meshes under `package://` are served from the folders of the setting
                `packages`.
            frame_prefix: start of the name of each frame, such as `anna/`.
            publish_frequency: maximum rate in Hz at which each joint's transform is published; joint states
                in between are dropped.

        Raises:
            InvalidDescription: `urdf` is not a valid description; the text names the joint or the link.
            ValueError: `publish_frequency` is out of range.
        """
        from rwt_participant.description import DescriptionHandle  # Most programs have no use for it.

        return DescriptionHandle(
            self.subscribe, self.advertise, self.tf, urdf, frame_prefix, publish_frequency
        )

    # -- safety ----------------------------------------------------------------------------------------------

    def on_emergency_stop(
        self, stop: Callable[[], None], release: Callable[[], None] | None = None
    ) -> Handle:
        """Call `stop` when the emergency stop of the gate is pressed, and `release` when it is released.

        A stop that is already pressed calls `stop` at once. Without a gate, neither is called. Requires
        permission to subscribe to `/gate/stopped`.

        Args:
            stop: plain function, called on the thread of the graph or the connection; it should be fast. If
                it raises, that is logged, and it is called again twice a second until the release.
            release: plain function; None to do nothing.

        Raises:
            TypeError: they are not plain functions.
        """
        from rwt_participant.emergency_stop import EmergencyStopHandle  # Most programs have no use for it.

        return EmergencyStopHandle(self.subscribe, self.clock, stop, release)

    # -- time ------------------------------------------------------------------------------------------------

    def create_timer(
        self, period: float, callback: Callable[[], Awaitable[None] | None], *, threaded: bool = False
    ) -> PeriodicTimer:
        """Call `callback` every `period` seconds of :attr:`clock`, first after one period.

        A coroutine function runs as a task; a tick that is due while it still runs is skipped. Missed ticks
        are skipped too, so the timer never catches up in a burst.

        Args:
            period: from a microsecond to some thirty years.
            threaded: True runs a plain function in a thread of a bounded pool, as a task.

        Raises:
            ValueError: `period` is out of range.
        """

    async def time_ns(self) -> int:
        """Return the robot's time, nanoseconds since the epoch; simulated if the robot's is.

        A node's `clock.time_ns()` returns the same without waiting.

        Raises:
            CallFailed: of a client: the robot does not answer.
        """
