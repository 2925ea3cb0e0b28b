"""The verbs that a program has for a robot, whether it is a node of the graph or a client of a server.

What tells the robot something is a plain function: `advertise`, `publish`, `subscribe`, `topic`,
`advertise_service`, `advertise_action`, and so is `create_timer`. What asks it something is a coroutine:
`call`, `once`, `send_goal`, parameters, transforms. So no `await` can be forgotten without its answer being
missed.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Protocol

from rwt_participant.future import USUAL, Timeout
from rwt_participant.goals import Execute, Goal
from rwt_participant.handles import Handle, Publisher, Subscription
from rwt_participant.messages import Message, MessageCallback, MessageLike, ParameterValue, ServiceHandler
from rwt_participant.qos import QoS
from rwt_participant.timers import PeriodicTimer
from rwt_participant.transforms import Transforms


class Parameters(Protocol):
    """The parameters of all nodes: `/node:name` on ROS 2, `/name` on ROS 1 (API-08).

    A name without a node is one of the global tree, which ROS 2 has besides for programs of ROS 1.
    """

    async def get(self, name: str, default: ParameterValue = None) -> ParameterValue:
        """The value of a parameter.

        Args:
            default: what to return when there is no such parameter; None raises instead.

        Raises:
            NotFound: there is none, or no such node, and there is no default.
            CallFailed: its node, or the robot, did not answer.
        """

    async def set(self, name: str, value: ParameterValue) -> None:
        """Give a parameter a value; returns once its node has taken it.

        Raises:
            ParameterRejected: the node does not take it, or there is none of that name; says why.
            CallFailed: its node did not answer.
        """

    async def has(self, name: str) -> bool:
        """Whether there is such a parameter, with a value. Raises :exc:`CallFailed`."""

    async def delete(self, name: str) -> None:
        """Remove a parameter.

        Raises:
            NotFound: there is none of that name, or no such node.
            ParameterRejected: its node does not allow it.
            CallFailed: its node did not answer.
        """

    async def names(self) -> tuple[str, ...]:
        """The full names of all parameters, sorted. Raises :exc:`CallFailed`."""


class RobotApi(Protocol):
    """A robot as a program sees it: :class:`rwt_graph.Node` and :class:`rwt_client.Robot` are such.

    Beyond what each verb names, a node raises :exc:`~rwt_graph.InvalidGraphName` for a name that ROS does not
    allow, and :exc:`~rwt_graph.TypeConflict` for a topic that is established with another type; a client
    raises :exc:`~rwt_client.NotConnected` where a message or a goal finds no connection.

    Attributes:
        params: the parameters of all nodes.
    """

    params: Parameters

    @property
    def tf(self) -> Transforms:
        """Where the frames are; listens to `/tf` and `/tf_static` from the first question on."""

    def advertise(self, topic: str, type: str, *, qos: QoS | None = None, latch: bool = False) -> Publisher:
        """Become a publisher of a topic.

        Args:
            type: `std_msgs/String` or `std_msgs/msg/String`.
            qos: keep-last 10, reliable, volatile by default.
            latch: keep the last message for late joiners; the same as `qos=LATCHED`.

        Raises:
            UnknownType: no such message is known; of a client, from the first `publish`, or when awaited.
        """

    def publish(
        self, topic: str, message: MessageLike, type: str | None = None, *, latch: bool = False
    ) -> Publisher:
        """Publish one message; the topic is advertised with the first, and stays so.

        Args:
            message: anything :data:`~rwt_participant.messages.MessageLike`.
            type: None takes that of the message's class, or the topic's own.
            latch: of the first message: keep the last message for late joiners.

        Raises:
            InvalidMessage: the message does not fit the type; of a client, when awaited, where it must ask
                the robot for the type first.
            UnknownType: no such message is known; of a client, when awaited.
            NotFound: no type was given and the topic has none; of a client, when awaited.
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
    ) -> Handle:
        """Call `callback` with each message of a topic.

        Args:
            callback: a plain function is called at once, on the thread of the graph or the connection, and
                should be quick. A coroutine function is called in one task with one message after the other;
                while it is busy the newest `queue_size` messages wait, or fewer that are `queue_bytes`
                together; the newest waits however big it is.
            type: None takes the topic's own: of a node, as soon as it has one; a client asks the robot, which
                must know the topic.
            qos: by default whatever the publishers offer.

        Raises:
            UnknownType: no such message is known; of a client, when awaited.
            NotFound: of a client, when awaited: no type was given, and there is no such topic.
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
        """The messages of a topic from now on, as an asynchronous iterator; arguments as for `subscribe`."""

    async def once(self, topic: str, type: str | None = None, *, timeout: Timeout = USUAL) -> Message:
        """The next message of a topic, or the one that it keeps for late joiners.

        Raises:
            TimedOut: none came in time.
            UnknownType: no such message is known.
            NotFound: of a client: no type was given, and there is no such topic.
        """

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
            request: None for one of defaults.
            type: the service's type. None asks the robot for it, once for each service; a node checks the
                request by the service's own type in any case.
            timeout: seconds; None waits as long as it takes. By default what the node or connection has.

        Returns:
            The response, an instance of its class.

        Raises:
            ProviderNotFound: nobody offers it (a :exc:`CallFailed` and a :exc:`NotFound`).
            ServiceFailed: its provider says so; its text.
            CallTimeout: no answer came in time.
            CallFailed: base of these, and of whatever else ended it: ProviderGone, ConnectionLost.
            InvalidMessage: the request does not fit the service's type, or the response does not.
            UnknownType: no such service is known.
        """

    def advertise_service(self, service: str, type: str, handler: ServiceHandler) -> Handle:
        """Offer a service; a provider of the same name in this program is replaced.

        Args:
            handler: takes the request and gives the response, anything
                :data:`~rwt_participant.messages.MessageLike`, or None for one of defaults. It raises
                :exc:`~rwt_participant.errors.ServiceFailed` to tell the caller why there is none; any other
                exception is logged and fails the call, too. A plain function runs on the thread of the graph
                or the connection; use a coroutine function for what takes time, with
                `anyio.to_thread.run_sync` for what blocks. Its calls may overlap.

        Raises:
            UnknownType: no such service is known; of a client, when awaited.
            TypeError: `handler` is no function.
        """

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
            goal: None for one of defaults.
            type: the action's type; None asks the robot for it.
            on_feedback: a plain function, called with each feedback; without it iterate over the goal.

        Raises:
            ProviderNotFound: nobody offers the action; where the robot does not say so at once, from the
                goal's `result`.
            GoalRejected: its server refuses; from `result`, too, where the robot does not say so at once.
            ProviderGone: of a node: its server went away meanwhile.
            InvalidMessage: the goal does not fit the action's type.
            UnknownType: no such action is known.
        """

    def advertise_action(self, action: str, type: str, execute: Execute) -> Handle:
        """Offer an action; a server of the same name in this program is replaced.

        Args:
            execute: a coroutine function that works on one goal and returns its result; goals run side by
                side, each in a task. It raises GoalCanceled or GoalAborted to end a goal otherwise than by
                success; any other exception ends it as aborted. Cancelled when the action is withdrawn.

        Raises:
            UnknownType: no such action is known; of a client, when awaited.
            TypeError: of a node: `execute` is not a coroutine function.
        """

    def create_timer(self, period: float, callback: Callable[[], Awaitable[None] | None]) -> PeriodicTimer:
        """Call `callback` every `period` seconds, first after one period.

        Seconds are of a node's graph's clock, of a client's computer. A coroutine function runs as a task; a
        tick that comes while it still runs is skipped. Ticks that were missed are skipped too, so the rate
        never catches up in a burst.

        Args:
            period: from a microsecond to some thirty years.

        Raises:
            ValueError: `period` is out of its range.
        """

    async def time_ns(self) -> int:
        """The robot's time, nanoseconds since the epoch; simulated where the robot is.

        A node's `clock.time_ns()` gives the same without waiting.

        Raises:
            CallFailed: the robot does not tell.
        """
