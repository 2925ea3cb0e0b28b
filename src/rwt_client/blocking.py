"""Client for notebooks and scripts: every call blocks, and an event loop runs in a thread behind it.

>>> with connect("ws://robot:9090") as robot:
...     robot.publish("/cmd_vel", {"linear": {"x": 0.2}}, "geometry_msgs/Twist")
...     print(robot.once("/odom").pose.pose.position)

Callbacks and handlers run in that thread; see :mod:`rwt_participant.blocking`.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack
from functools import partial
from typing import Any, Self, TypeVar, Unpack

from anyio.from_thread import BlockingPortal, start_blocking_portal

from rwt_client import connection
from rwt_client.connection import ConnectKeywords
from rwt_client.endpoints.publisher import RemotePublisher
from rwt_client.endpoints.remote_types import RemoteTypes
from rwt_client.endpoints.subscriptions import RemoteSubscription
from rwt_client.endpoints.transforms import RemoteTransforms
from rwt_client.errors import ConnectionClosed, MessageRejected
from rwt_client.events import ConnectionEvent
from rwt_client.robot import Robot
from rwt_client.rosapi import RosApi
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.blocking import (
    Blocking,
    BlockingGoal,
    BlockingHandle,
    BlockingPublisher,
    BlockingSubscription,
    BlockingTransforms,
    BlockingVerbs,
    LoopThread,
    holds,
    iterate,
    runs,
    waits,
)
from rwt_participant.errors import RobotError, WrongThread
from rwt_participant.messages import MessageLike, check_arguments
from rwt_participant.threads.outbox import Outbox
from rwt_participant.timers import RobotClock
from rwt_transports.endpoint import Accept

logger = logging.getLogger("rwt_client")

T = TypeVar("T")


class _PortalThread(LoopThread):
    """Event loop of a connection in its thread.

    Attributes:
        closed: True if this program has closed the connection, and with it the loop.
    """

    def __init__(self, portal: BlockingPortal) -> None:
        self._portal = portal
        self._thread = portal.call(threading.get_ident)
        self._loop = portal.call(asyncio.get_running_loop)
        self.closed = False

    @property
    def here(self) -> bool:
        return threading.get_ident() == self._thread

    def run(self, function: Callable[[], T]) -> T:
        if self.here:
            return function()

        async def run() -> T:
            return function()

        return self.wait(run)

    def post(self, function: Callable[[], None]) -> None:
        def run() -> None:
            try:
                function()
            except RobotError as error:
                logger.warning("a message was not published: %s", error)

        try:
            # Not the portal: it waits until the loop has started a task.
            self._loop.call_soon_threadsafe(run)
        except RuntimeError:
            raise self._closed_error() from None

    def wait(self, function: Callable[[], Awaitable[T]]) -> T:
        if self.here:
            raise WrongThread("a blocking call in a callback would wait for itself: use a coroutine function")
        try:
            pending = self._portal.start_task_soon(function)
        except RuntimeError:
            if not self.closed:
                raise
            raise self._closed_error() from None
        return pending.result()

    @staticmethod
    def _closed_error() -> ConnectionClosed:
        return ConnectionClosed("the connection was closed by this program")


class BlockingApi(Blocking[RosApi]):
    """Queries of rosapi; see :class:`rwt_client.rosapi.RosApi`."""

    topics = waits(RosApi.topics)
    topics_for_type = waits(RosApi.topics_for_type)
    topic_type = waits(RosApi.topic_type)
    publishers = waits(RosApi.publishers)
    subscribers = waits(RosApi.subscribers)
    nodes = waits(RosApi.nodes)
    node = waits(RosApi.node)
    services = waits(RosApi.services)
    services_for_type = waits(RosApi.services_for_type)
    service_type = waits(RosApi.service_type)
    service_node = waits(RosApi.service_node)
    service_host = waits(RosApi.service_host)
    service_providers = waits(RosApi.service_providers)
    action_servers = waits(RosApi.action_servers)
    action_type = waits(RosApi.action_type)
    interfaces = waits(RosApi.interfaces)
    message_details = waits(RosApi.message_details)
    service_request_details = waits(RosApi.service_request_details)
    service_response_details = waits(RosApi.service_response_details)
    action_goal_details = waits(RosApi.action_goal_details)
    action_result_details = waits(RosApi.action_result_details)
    action_feedback_details = waits(RosApi.action_feedback_details)
    time_ns = waits(RosApi.time_ns)
    ros_version = waits(RosApi.ros_version)


class BlockingClientSubscription(BlockingSubscription):
    """Messages of a topic; see :class:`rwt_client.endpoints.subscriptions.RemoteSubscription`."""

    _inner: RemoteSubscription

    @property
    def received(self) -> int:
        """Number of received messages."""
        return self._inner.received

    @property
    def received_bytes(self) -> int:
        """Size of the received messages on the connection, in bytes."""
        return self._inner.received_bytes

    @property
    def invalid(self) -> int:
        """Number of messages that did not fit the type."""
        return self._inner.invalid

    @property
    def type(self) -> MessageType:
        """Type of the topic. Raises UnknownType until the robot has answered: call `ready` first."""
        return self._inner.type

    def __next__(self) -> Any:
        try:
            return super().__next__()
        except ConnectionClosed:
            raise StopIteration from None


class BlockingClientPublisher(BlockingPublisher):
    """Publisher of one topic; see :class:`rwt_client.endpoints.publisher.RemotePublisher`."""

    _inner: RemotePublisher

    def __init__(self, loop: LoopThread, inner: RemotePublisher) -> None:
        super().__init__(loop, inner)
        self._outbox: Outbox[MessageLike] = Outbox(inner.name, inner.publish, loop.post)

    def publish(self, message: MessageLike) -> None:
        """Publish one message; see :meth:`RemotePublisher.publish`.

        It does not wait for the connection's thread. While that is held, the newest messages are kept, and
        :attr:`dropped` counts the others.
        """
        if self._loop.here:
            self._inner.publish(message)
            return
        checked = self._inner.checked(message)
        self._outbox.put(checked, checked.kept_size if isinstance(checked, Payload) else 0)

    @property
    def dropped(self) -> int:
        """Number of messages that were dropped for newer ones: here, or because the network was too slow."""
        return self._inner.dropped + self._outbox.dropped

    @property
    def type(self) -> MessageType:
        """Type of the topic. Raises UnknownType until the robot has answered: call `ready` first."""
        return self._inner.type

    @property
    def sent(self) -> int:
        """Number of messages published."""
        return self._inner.sent

    @property
    def error(self) -> RobotError | None:
        """Reason that :meth:`publish` rejects every message; None while messages are accepted."""
        return self._inner.error

    @property
    def rejection(self) -> MessageRejected | None:
        """First rejection since the last :meth:`confirm`, which raises it."""
        return self._inner.rejection

    drain = waits(RemotePublisher.drain)
    confirm = waits(RemotePublisher.confirm)

    @property
    def rejected(self) -> int:
        """Number of messages that the server has rejected so far."""
        return self._inner.rejected


class BlockingRemoteTransforms(BlockingTransforms):
    """Transforms between frames; see :class:`rwt_client.endpoints.transforms.RemoteTransforms`."""

    start_compact = waits(RemoteTransforms.start_compact)


class BlockingClientClock(Blocking[RobotClock]):
    """Clock of this computer; see :class:`~rwt_participant.timers.RobotClock`."""

    monotonic = runs(RobotClock.monotonic)
    call_later = runs(RobotClock.call_later)
    sleep = waits(RobotClock.sleep)


class BlockingRobot(BlockingVerbs[Robot]):
    """Connection to a robot, with the methods of :class:`rwt_client.robot.Robot`.

    Attributes:
        api: queries of rosapi.
        params: parameters of all nodes.
        tf: transforms between frames.
        clock: clock of this computer.
        url: URL of the connection.
    """

    def __init__(self, loop: _PortalThread, inner: Robot, connection: ExitStack) -> None:
        super().__init__(loop, inner)
        self._thread = loop
        self._connection = connection
        self.api = BlockingApi(loop, inner.api)
        self.tf = BlockingRemoteTransforms(loop, inner.tf)
        self.clock = BlockingClientClock(loop, inner.clock)
        self.url = inner.url
        self._publishers: dict[str, BlockingClientPublisher] = {}

    def publish(
        self, topic: str, message: MessageLike, type: str | None = None, *, latch: bool = False
    ) -> BlockingClientPublisher:
        """Publish one message. The first one waits until the topic is advertised, later ones do not wait.

        See :meth:`RobotApi.publish`.
        """
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self._advertised(topic, message, type, latch=latch)
            return publisher
        if type is not None:
            check_arguments("publish(topic, message, type)", type)
        publisher.publish(message)
        return publisher

    _advertised = holds(Robot.publish, BlockingClientPublisher)
    advertise = holds(Robot.advertise, BlockingClientPublisher)
    subscribe = holds(Robot.subscribe, BlockingClientSubscription)
    topic = holds(Robot.topic, BlockingClientSubscription)
    once = waits(Robot.once)
    call = waits(Robot.call)
    send_goal = holds(Robot.send_goal, BlockingGoal)
    identify = waits(Robot.identify)
    advertise_action = holds(Robot.advertise_action, BlockingHandle)
    drain = waits(Robot.drain)
    wait_connected = waits(Robot.wait_connected)

    @property
    def connected(self) -> bool:
        """True if there is a connection now."""
        return self._inner.connected

    @property
    def types(self) -> RemoteTypes:
        """Types of the robot; to fetch one: ``robot.run(robot.types.fetch, name)``."""
        return self._inner.types

    def run(self, function: Callable[..., Awaitable[T]], *args: Any) -> T:
        """Run a coroutine function on the robot's event loop and wait for it."""
        return self._loop.wait(partial(function, *args))

    def events(self) -> Iterator[ConnectionEvent]:
        """Return the events of the connection from now on, as an iterator that waits for them."""
        return iterate(self._loop, self._loop.run(self._inner.events))

    def on_event(self, callback: Callable[[ConnectionEvent], object]) -> Callable[[], None]:
        """Call `callback`, in the robot's thread, with each event of the connection."""
        end = self._loop.run(partial(self._inner.on_event, callback))
        return lambda: self._loop.run(end)

    def close(self) -> None:
        """Close the connection; `with` does so at its end."""
        self._thread.closed = True
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def connect(target: str | Accept, **options: Unpack[ConnectKeywords]) -> BlockingRobot:
    """Connect to a robot, as :func:`rwt_client.connect`; use it in a `with` block, or close it when done."""
    with ExitStack() as stack:
        portal = stack.enter_context(start_blocking_portal("asyncio"))
        connecting = portal.wrap_async_context_manager(connection.connect(target, **options))
        robot = stack.enter_context(connecting)
        return BlockingRobot(_PortalThread(portal), robot, stack.pop_all())
