"""The same client for notebooks and scripts: every call waits, and an event loop runs in a thread behind it.

>>> with connect("ws://robot:9090") as robot:
...     robot.publish("/cmd_vel", {"linear": {"x": 0.2}}, "geometry_msgs/Twist")
...     print(robot.once("/odom").pose.pose.position)

Callbacks and handlers run in that thread: they should be quick, and must not call this face of the robot.
"""

from __future__ import annotations

import functools
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack
from typing import Any, Concatenate, ParamSpec, TypeVar, TypeVarTuple, Unpack, overload

from anyio.from_thread import BlockingPortal, start_blocking_portal

from rwt_client import connection
from rwt_client.connection import ConnectKeywords
from rwt_client.endpoints.action_server import ActionServer
from rwt_client.endpoints.goals import Goal
from rwt_client.endpoints.parameters import Parameters
from rwt_client.endpoints.publisher import Publisher
from rwt_client.endpoints.remote_types import RemoteTypes
from rwt_client.endpoints.services import ServiceHandler, ServiceServer
from rwt_client.endpoints.subscriptions import Callback, Subscription
from rwt_client.endpoints.transforms import Transforms
from rwt_client.errors import ConnectionClosed
from rwt_client.events import ConnectionEvent
from rwt_client.robot import AdvertiseKeywords, Robot, SubscribeKeywords
from rwt_client.rosapi import RosApi
from rwt_program.goals import Execute, GoalResult, GoalStatus
from rwt_program.messages import Message, MessageLike
from rwt_protocol.transport import Accept

P = ParamSpec("P")
T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")
S = TypeVar("S")


class _Loop:
    """The event loop in its thread.

    Attributes:
        closed: whether this program has closed the connection, and the loop with it.
    """

    def __init__(self, portal: BlockingPortal) -> None:
        self._portal = portal
        self.closed = False

    @overload
    def call(self, function: Callable[[Unpack[Arguments]], Awaitable[T]], *args: *Arguments) -> T: ...

    @overload
    def call(self, function: Callable[[Unpack[Arguments]], T], *args: *Arguments) -> T: ...

    def call(self, function: Callable[[Unpack[Arguments]], Any], *args: *Arguments) -> Any:
        """Run a function there and wait for it.

        Raises:
            ConnectionClosed: the connection was closed before.
        """
        try:
            pending = self._portal.start_task_soon(function, *args)
        except RuntimeError:
            if not self.closed:
                raise
            raise ConnectionClosed("the connection was closed by this program") from None
        return pending.result()


class _Face:
    """Something of an asynchronous robot, for other threads."""

    def __init__(self, portal: _Loop, inner: Any) -> None:
        self._portal = portal
        self._inner = inner


def _waits(method: Callable[Concatenate[S, P], Awaitable[T]]) -> Callable[Concatenate[_Face, P], T]:
    """The same method, waited for from another thread."""

    @functools.wraps(method)
    def wait(self: _Face, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._portal.call(functools.partial(method, self._inner, *args, **kwargs))

    return wait


class BlockingApi(_Face):
    """What rosapi answers; see :class:`rwt_client.rosapi.RosApi`."""

    topics = _waits(RosApi.topics)
    topics_for_type = _waits(RosApi.topics_for_type)
    topic_type = _waits(RosApi.topic_type)
    publishers = _waits(RosApi.publishers)
    subscribers = _waits(RosApi.subscribers)
    nodes = _waits(RosApi.nodes)
    node = _waits(RosApi.node)
    services = _waits(RosApi.services)
    services_for_type = _waits(RosApi.services_for_type)
    service_type = _waits(RosApi.service_type)
    service_node = _waits(RosApi.service_node)
    service_host = _waits(RosApi.service_host)
    service_providers = _waits(RosApi.service_providers)
    action_servers = _waits(RosApi.action_servers)
    action_type = _waits(RosApi.action_type)
    interfaces = _waits(RosApi.interfaces)
    message_details = _waits(RosApi.message_details)
    service_request_details = _waits(RosApi.service_request_details)
    service_response_details = _waits(RosApi.service_response_details)
    action_goal_details = _waits(RosApi.action_goal_details)
    action_result_details = _waits(RosApi.action_result_details)
    action_feedback_details = _waits(RosApi.action_feedback_details)
    time_ns = _waits(RosApi.time_ns)
    ros_version = _waits(RosApi.ros_version)


class BlockingParameters(_Face):
    """The parameters of a robot; see :class:`rwt_client.endpoints.parameters.Parameters`."""

    get = _waits(Parameters.get)
    set = _waits(Parameters.set)
    has = _waits(Parameters.has)
    delete = _waits(Parameters.delete)
    names = _waits(Parameters.names)


class BlockingTransforms(_Face):
    """Where the robot's frames are; see :class:`rwt_client.endpoints.transforms.Transforms`."""

    _inner: Transforms

    start = _waits(Transforms.start)
    start_compact = _waits(Transforms.start_compact)
    lookup = _waits(Transforms.lookup)
    lookup_full = _waits(Transforms.lookup_full)
    can_transform = _waits(Transforms.can_transform)

    def tree(self) -> str:
        """The frames heard of so far, as indented text."""
        return self._portal.call(self._inner.buffer.tree)

    def close(self) -> None:
        """Listen no more."""
        self._portal.call(self._inner.close)


class BlockingSubscription(_Face):
    """The messages of a topic, as an iterator."""

    _inner: Subscription

    get = _waits(Subscription.get)

    @property
    def dropped(self) -> int:
        """Messages that were dropped because nobody took them in time."""
        return self._inner.dropped

    @property
    def received(self) -> int:
        """Messages that have arrived."""
        return self._inner.received

    def close(self) -> None:
        """Unsubscribe."""
        self._portal.call(self._inner.close)

    def __enter__(self) -> BlockingSubscription:
        self._portal.call(self._inner.start)
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __iter__(self) -> BlockingSubscription:
        return self

    def __next__(self) -> Message:
        try:
            return self._portal.call(self._inner.get)
        except ConnectionClosed:
            raise StopIteration from None


class BlockingPublisher(_Face):
    """Publishes on one topic; see :class:`rwt_client.endpoints.publisher.Publisher`."""

    _inner: Publisher

    drain = _waits(Publisher.drain)

    def publish(self, message: MessageLike) -> None:
        """Publish one message."""
        self._portal.call(self._inner.publish, message)

    def close(self) -> None:
        """Withdraw the advertisement."""
        self._portal.call(self._inner.close)

    def __enter__(self) -> BlockingPublisher:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class BlockingGoal(_Face):
    """A goal that was sent, and an iterator over its feedback."""

    _inner: Goal

    @property
    def status(self) -> GoalStatus:
        """What is known of it so far."""
        return self._inner.status

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._inner.done

    def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the end of the goal; see :meth:`rwt_client.endpoints.goals.Goal.result`."""
        return self._portal.call(self._inner.result, timeout)

    def cancel(self) -> None:
        """Ask that the goal end early."""
        self._portal.call(self._inner.cancel)

    def __iter__(self) -> Iterator[Message]:
        feedback = self._inner.feedback()
        while (message := self._portal.call(anext, feedback, None)) is not None:
            yield message


class BlockingOffer(_Face):
    """A service or an action that this program offers."""

    _inner: ServiceServer | ActionServer

    @property
    def name(self) -> str:
        """Its name."""
        return self._inner.name

    def close(self) -> None:
        """Withdraw it."""
        self._portal.call(self._inner.close)

    def __enter__(self) -> BlockingOffer:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class BlockingRobot(_Face):
    """A robot; see :class:`rwt_client.robot.Robot`, whose methods these are.

    Attributes:
        api: what rosapi answers.
        params: its parameters.
        tf: where its frames are.
    """

    _inner: Robot

    def __init__(self, portal: _Loop, inner: Robot) -> None:
        super().__init__(portal, inner)
        self.api = BlockingApi(portal, inner.api)
        self.params = BlockingParameters(portal, inner.params)
        self.tf = BlockingTransforms(portal, inner.tf)
        self._close: Callable[[], None] = _nothing

    once = _waits(Robot.once)
    publish = _waits(Robot.publish)
    call = _waits(Robot.call)
    time_ns = _waits(Robot.time_ns)
    drain = _waits(Robot.drain)
    wait_connected = _waits(Robot.wait_connected)

    @property
    def connected(self) -> bool:
        """Whether there is a connection now."""
        return self._inner.connected

    @property
    def types(self) -> RemoteTypes:
        """The robot's types; to fetch one: ``robot.run(robot.types.fetch, name)``."""
        return self._inner.types

    def run(self, function: Callable[..., Awaitable[T]], *args: Any) -> T:
        """Run a coroutine function on the robot's event loop and wait for it."""
        return self._portal.call(function, *args)

    def on_event(self, callback: Callable[[ConnectionEvent], object]) -> Callable[[], None]:
        """Call `callback`, in the robot's thread, with what happens to the connection."""
        end = self._portal.call(self._inner.on_event, callback)
        return lambda: self._portal.call(end)

    def topic(
        self, name: str, type_name: str | None = None, **options: Unpack[SubscribeKeywords]
    ) -> BlockingSubscription:
        """The messages of a topic, as an iterator. Nothing is sent before the iteration begins."""
        make = functools.partial(self._inner.topic, name, type_name, **options)
        return BlockingSubscription(self._portal, self._portal.call(make))

    def subscribe(
        self, name: str, type_name: str | None, callback: Callback, **options: Unpack[SubscribeKeywords]
    ) -> BlockingSubscription:
        """Call `callback`, in the robot's thread, with each message of a topic."""
        subscribe = functools.partial(self._inner.subscribe, name, type_name, callback, **options)
        return BlockingSubscription(self._portal, self._portal.call(subscribe))

    def advertise(self, name: str, type_name: str, **options: Unpack[AdvertiseKeywords]) -> BlockingPublisher:
        """Advertise a topic; gives what publishes on it."""
        advertise = functools.partial(self._inner.advertise, name, type_name, **options)
        return BlockingPublisher(self._portal, self._portal.call(advertise))

    def advertise_service(self, service: str, type_name: str, handler: ServiceHandler) -> BlockingOffer:
        """Offer a service; the handler runs in the robot's thread."""
        offered = self._portal.call(self._inner.advertise_service, service, type_name, handler)
        return BlockingOffer(self._portal, offered)

    def advertise_action(self, action: str, type_name: str, execute: Execute) -> BlockingOffer:
        """Offer an action; `execute` is a coroutine function and runs on the robot's event loop."""
        offered = self._portal.call(self._inner.advertise_action, action, type_name, execute)
        return BlockingOffer(self._portal, offered)

    def send_goal(
        self,
        action: str,
        goal: MessageLike | None = None,
        type_name: str | None = None,
        *,
        on_feedback: Callable[[Any], object] | None = None,
    ) -> BlockingGoal:
        """Send a goal to an action."""
        send = functools.partial(self._inner.send_goal, action, goal, type_name, on_feedback=on_feedback)
        return BlockingGoal(self._portal, self._portal.call(send))

    def close(self) -> None:
        """Close the connection, for those who do not use ``with``."""
        close, self._close = self._close, _nothing
        close()

    def when_closed(self, close: Callable[[], None]) -> None:
        """What :meth:`close` does."""
        self._close = close

    def __enter__(self) -> BlockingRobot:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return repr(self._inner)


def _nothing() -> None:
    """It is closed already."""


def connect(target: str | Accept, **options: Unpack[ConnectKeywords]) -> BlockingRobot:
    """Connect to a robot; use it as a context manager, or close it when done.

    Args:
        target: as for :func:`rwt_client.connect`.
        options: as for :func:`rwt_client.connect`.

    Raises:
        BadAddress: the URL is not one to connect to.
        CannotConnect: there is no connection; says why.
    """
    with ExitStack() as stack:
        portal = stack.enter_context(start_blocking_portal())
        connecting = portal.wrap_async_context_manager(connection.connect(target, **options))
        loop = _Loop(portal)
        robot = BlockingRobot(loop, stack.enter_context(connecting))
        everything = stack.pop_all()

        def close() -> None:
            loop.closed = True
            everything.close()

        robot.when_closed(close)
    return robot
