"""Robot at the other end of a connection."""

from __future__ import annotations

import logging
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import AbstractContextManager, suppress
from functools import partial
from typing import Any, Final, Unpack
from uuid import uuid4

import anyio
import msgspec

from rwt_client.endpoints.goals import ActionlibGoal, WireGoal
from rwt_client.endpoints.publisher import AdvertiseOptions, RemotePublisher
from rwt_client.endpoints.remote_handle import ClientConnection
from rwt_client.endpoints.remote_types import RemoteTypes
from rwt_client.endpoints.servers import ActionServer, Offered, ServiceServer
from rwt_client.endpoints.services import WireCall, call_service
from rwt_client.endpoints.subscriptions import RawSubscription, RemoteSubscription, SubscribeOptions
from rwt_client.endpoints.transforms import RemoteTransforms
from rwt_client.errors import ConnectionClosed
from rwt_client.events import ConnectionEvent, EventStream
from rwt_client.rosapi import RosApi
from rwt_client.wire.arrays import ArrayKind
from rwt_client.wire.session import ReconnectingSession
from rwt_interfaces import NOETIC, Distro
from rwt_interfaces.distro import closest_distro
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.api import ACTION_PARTS, SERVICE_EVENTS, Listed, RobotApi
from rwt_participant.errors import (
    CallTimeout,
    InvalidMessage,
    ProviderNotFound,
    RobotError,
    ServiceFailed,
    TimedOut,
    UnknownType,
)
from rwt_participant.future import USUAL, Future, Timeout
from rwt_participant.goals import BlockingExecute, Execute, Goal, check_execute
from rwt_participant.messages import (
    Message,
    MessageCallback,
    MessageLike,
    RawCallback,
    ServiceHandler,
    check_arguments,
    to_payload,
    type_of,
)
from rwt_participant.rosapi_parameters import UNANSWERED, RosapiParameters
from rwt_participant.threads.pool import HandlerThreads
from rwt_participant.timers import PeriodicTimer, RobotClock, Timer
from rwt_protocol.dispatcher import Dispatcher
from rwt_protocol.errors import MalformedPayload
from rwt_protocol.ops import (
    ActionFeedback,
    ActionResult,
    CallService,
    CancelActionGoal,
    Direction,
    Op,
    Publish,
    SendActionGoal,
    ServiceResponse,
    Status,
)
from rwt_protocol.payloads import RawJson
from rwt_transports.background import TaskStarter

logger = logging.getLogger("rwt_client")

IDENTIFY_SECONDS = 3.0
"""Timeout of questions to rosapi while connecting, in seconds."""

_ROSAPI: Final = "/rosapi"

_QUESTIONS: Final = 16
"""Maximum number of concurrent questions for the types of a listing."""

_ACTION_TOPICS: Final = (
    "feedback", "status", f"send_goal{SERVICE_EVENTS}", f"get_result{SERVICE_EVENTS}",
)  # fmt: skip


class Robot(RobotApi):
    """Connection to a robot; made by :func:`rwt_client.connect`.

    Attributes:
        url: URL of the connection.
        types: types of the robot.
        api: queries of rosapi.
        params: parameters of all nodes.
        handler_threads: threads for handlers that block (`threaded=True`).
    """

    def __init__(
        self,
        url: str,
        session: ReconnectingSession,
        tasks: TaskStarter,
        drained: Callable[[], Awaitable[None]],
        *,
        timeout: float | None,
        arrays: ArrayKind,
        binary: bool,
    ) -> None:
        self.url = url
        self._session = session
        ask = partial(self._ask, timeout)
        brief = IDENTIFY_SECONDS if timeout is None else min(timeout, IDENTIFY_SECONDS)
        self._identifying = RosApi(partial(self._ask, brief))
        self.types = RemoteTypes(ask)
        self.api = RosApi(ask)
        self.params = RosapiParameters(ask)
        self._timeout = timeout
        self._arrays: ArrayKind = arrays
        self._connection = ClientConnection(session, self.types, tasks, drained, timeout, binary)
        self._tf = RemoteTransforms(self._connection, self.subscribe, self.advertise, self.call, timeout)
        session.events.listen(self._tf.on_event)
        self._services: Offered[ServiceServer] = Offered()
        self._actions: Offered[ActionServer] = Offered()
        self._publishers: dict[str, RemotePublisher] = {}
        self._clock = _ClientClock(tasks)
        self.handler_threads = HandlerThreads()
        session.dispatcher = self._dispatcher()

    @property
    def tf(self) -> RemoteTransforms:
        return self._tf

    @property
    def clock(self) -> RobotClock:
        return self._clock

    # -- the connection --------------------------------------------------------------------------------------

    @property
    def connected(self) -> bool:
        """True if there is a connection now."""
        return self._session.connected

    async def wait_connected(self, *, timeout: Timeout = USUAL) -> None:
        """Wait until there is a connection, with everything subscribed, advertised and offered on it again.

        Raises:
            TimedOut: there was no connection in time.
            ConnectionClosed: there will be no connection any more.
        """
        if self.connected:
            return
        connected: Future[None] = Future()

        def look(event: ConnectionEvent) -> None:
            if event.kind in ("connected", "restored"):
                connected.set(None)
            elif event.kind == "closed":
                connected.set(ConnectionClosed(event.text or "the connection was closed"))

        end = self.on_event(look)
        try:
            await connected.get(self._patience(timeout), "there was no connection to the server")
        finally:
            end()

    def events(self) -> EventStream:
        """Return the events of the connection from now on, as an async iterator."""
        return self._session.events.stream()

    def on_event(self, callback: Callable[[ConnectionEvent], object]) -> Callable[[], None]:
        """Call `callback` with each event of the connection; returns a function that ends this."""
        return self._session.events.listen(callback)

    async def drain(self) -> None:
        """Wait until the network has taken everything that was sent."""
        await self._connection.drained()

    # -- listings --------------------------------------------------------------------------------------------

    async def topics(self, *, hidden: bool = False) -> tuple[Listed, ...]:
        found = {each.name: each for each in await self.api.topics()}
        if hidden:
            names = [name for name in await self._hidden_names() if name not in found]
            found |= {each.name: each for each in await self._typed(names, self.api.topic_type) if each.type}
        return tuple(found[name] for name in sorted(found))

    async def _hidden_names(self) -> list[str]:
        """Return the names that topics of service introspection and of actions would have (API-02)."""
        names = [f"{name}{SERVICE_EVENTS}" for name in await self.api.services()]
        if self.types.registry.distro.action_transport == "services":
            with suppress(*UNANSWERED):  # Some servers have no actions.
                actions = await self.api.action_servers()
                names += [f"{name}{ACTION_PARTS}{part}" for name in actions for part in _ACTION_TOPICS]
        return [name for name in names if not name.startswith(f"{_ROSAPI}/")]

    async def services(self) -> tuple[Listed, ...]:
        return await self._typed(await self.api.services(), self.types.of_service)

    async def actions(self) -> tuple[Listed, ...]:
        return await self._typed(await self.api.action_servers(), self.types.of_action)

    async def _typed(
        self, names: Iterable[str], type_of: Callable[[str], Awaitable[str]]
    ) -> tuple[Listed, ...]:
        """Return the names with their types, which are asked for concurrently; a type is empty without an
        answer."""
        types = dict.fromkeys(sorted(names), "")
        few = anyio.Semaphore(_QUESTIONS)

        async def ask(name: str) -> None:
            async with few:
                with suppress(RobotError):
                    types[name] = await type_of(name)

        async with anyio.create_task_group() as tasks:
            for name in types:
                tasks.start_soon(ask, name)
        return tuple(Listed(name, type) for name, type in types.items())

    async def type_of(self, topic: str) -> MessageType:
        return await self.types.message(await self.types.of_topic(topic))

    async def interface(self, name: str) -> MessageType | ServiceType | ActionType:
        types = self.types
        known = types.known_message(name) or types.known_service(name) or types.known_action(name)
        if known is not None:
            return known
        for fetch in (types.message, types.service, types.action):
            try:
                return await fetch(name)
            except UnknownType:
                continue
        raise UnknownType(f"no message, service or action of the name {name} is known")

    # -- topics ----------------------------------------------------------------------------------------------

    def topic(
        self, topic: str, type: str | None = None, **options: Unpack[SubscribeOptions]
    ) -> RemoteSubscription:
        check_arguments("topic(topic, type)", type)
        return self._subscribe(topic, None, type, options)

    def subscribe(
        self,
        topic: str,
        callback: MessageCallback,
        type: str | None = None,
        *,
        threaded: bool = False,
        **options: Unpack[SubscribeOptions],
    ) -> RemoteSubscription:
        """Call `callback` with each message of a topic; see :meth:`RobotApi.subscribe`.

        Args:
            options: see :class:`~rwt_client.endpoints.subscriptions.SubscribeOptions`.
        """
        check_arguments("subscribe(topic, callback, type)", type, callback)
        if threaded:
            callback = self.handler_threads.coroutine(callback)
        return self._subscribe(topic, callback, type, options)

    def _subscribe(
        self, topic: str, callback: MessageCallback | None, type: str | None, options: SubscribeOptions
    ) -> RemoteSubscription:
        options.setdefault("arrays", self._arrays)
        subscription = RemoteSubscription(self._connection, topic, callback, **options)
        return subscription.open(self.types.known_message(type), self._message_type(topic, type))

    def subscribe_raw(self, topic: str, callback: RawCallback, type: str | None = None) -> RawSubscription:
        check_arguments("subscribe_raw(topic, callback, type)", type, callback)

        async def ask() -> MessageType:
            name = type or await self.types.of_topic(topic)
            if self.types.known_message(name) is None:
                with suppress(RobotError):  # The definition with its comments and constants, if there is one.
                    await self.types.refresh()
            return await self.types.message(name)

        subscription = RawSubscription(self._connection, topic, callback)
        return subscription.open(self.types.known_message(type), ask)

    async def once(
        self,
        topic: str,
        type: str | None = None,
        *,
        timeout: Timeout = USUAL,
        **options: Unpack[SubscribeOptions],
    ) -> Message:
        """Return the next message of a topic, or the one that it retains; see :meth:`RobotApi.once`.

        Args:
            options: as for :meth:`subscribe`.

        Raises:
            ServerRefused: the server rejects the subscription; with its text.
        """
        try:
            async with self.topic(topic, type, **options) as messages:
                return await messages.get(self._patience(timeout))
        except TimedOut as error:
            raise TimedOut(f"{error}{await self.types.meant('topic', topic)}") from None

    def advertise(self, topic: str, type: str, **options: Unpack[AdvertiseOptions]) -> RemotePublisher:
        """Become a publisher of a topic; see :meth:`RobotApi.advertise`.

        Args:
            options: see :class:`~rwt_client.endpoints.publisher.AdvertiseOptions`.
        """
        check_arguments("advertise(topic, type)", type)
        return self._advertise(topic, type, options)

    def _advertise(self, topic: str, type: str | None, options: AdvertiseOptions) -> RemotePublisher:
        publisher = RemotePublisher(self._connection, topic, options)
        return publisher.open(self.types.known_message(type), self._message_type(topic, type))

    def publish(
        self, topic: str, message: MessageLike, type: str | None = None, *, latch: bool = False
    ) -> RemotePublisher:
        if type is not None:
            check_arguments("publish(topic, message, type)", type)
        publisher = self._publishers.get(topic)
        if publisher is None:
            wanted = type or type_of(message, self.types.registry)
            publisher = self._publishers[topic] = self._advertise(topic, wanted, {"latch": latch})
        publisher.publish(message)
        return publisher

    def _message_type(self, topic: str, type: str | None) -> Callable[[], Awaitable[MessageType]]:
        async def ask() -> MessageType:
            return await self.types.message(type or await self.types.of_topic(topic))

        return ask

    # -- services --------------------------------------------------------------------------------------------

    async def call(
        self,
        service: str,
        request: MessageLike | None = None,
        type: str | None = None,
        *,
        timeout: Timeout = USUAL,
        repeat: bool = False,
    ) -> Message:
        """Call a service and wait for its response; see :meth:`RobotApi.call`.

        Args:
            repeat: wait for a connection if there is none, and call again if it is lost before the answer.
                Only for idempotent services.
        """
        check_arguments("call(service, request, type)", type)
        service_type = await self.types.service_of(service, type)
        args = RawJson(to_payload(service_type.request, {} if request is None else request).json())
        try:
            answer = await call_service(self._session, service, args, self._patience(timeout), repeat=repeat)
        except ProviderNotFound as error:
            raise ProviderNotFound(f"{error}{await self.types.meant('service', service)}") from None
        return self.types.reader(service_type.response, self._arrays).read(answer)

    def advertise_service(
        self, service: str, type: str, handler: ServiceHandler, *, threaded: bool = False
    ) -> ServiceServer:
        check_arguments("advertise_service(service, type, handler)", type, handler)
        if threaded:
            handler = self.handler_threads.coroutine(handler)
        server = ServiceServer(self._connection, service, self._services, handler)
        return server.open(self.types.known_service(type), partial(self.types.service, type))

    # -- actions ---------------------------------------------------------------------------------------------

    async def send_goal(
        self,
        action: str,
        goal: MessageLike | None = None,
        type: str | None = None,
        *,
        on_feedback: Callable[[Message], object] | None = None,
    ) -> Goal:
        check_arguments("send_goal(action, goal, type)", type)
        action_type = await self.types.action_of(action, type)
        payload = to_payload(action_type.goal, {} if goal is None else goal)
        if self.types.registry.distro.action_transport == "topics":
            # Unlike ids of ops, unique among all programs: the action server keeps those of all clients.
            goal_id = f"{action}-{uuid4().hex}"
            over_topics = ActionlibGoal(action, goal_id, on_feedback)
            await over_topics.send(self.subscribe, self.advertise, action_type, payload)
            return over_topics
        sent = WireGoal(self._connection, action, on_feedback)
        sent.send(
            self.types.wire_name(action_type),
            RawJson(payload.json()),
            self.types.reader(action_type.feedback, self._arrays),
            self.types.reader(action_type.result, self._arrays),
        )
        return sent

    def cancel_goal(self, action: str, goal_id: str) -> None:
        if self.types.registry.distro.action_transport == "topics":
            self.publish(f"{action}/cancel", {"id": goal_id}, "actionlib_msgs/GoalID")
        elif isinstance(sent := self._session.find(goal_id), WireGoal):
            sent.cancel()
        else:
            self._session.send(CancelActionGoal(id=goal_id, action=action))

    def advertise_action(
        self, action: str, type: str, execute: Execute | BlockingExecute, *, threaded: bool = False
    ) -> ActionServer:
        check_arguments("advertise_action(action, type, execute)", type, execute)
        if threaded:
            execute = self.handler_threads.coroutine(execute)
        server = ActionServer(self._connection, action, self._actions, check_execute(action, execute))
        return server.open(self.types.known_action(type), partial(self.types.action, type))

    # -- time ------------------------------------------------------------------------------------------------

    def create_timer(
        self, period: float, callback: Callable[[], Awaitable[None] | None], *, threaded: bool = False
    ) -> PeriodicTimer:
        if threaded:
            callback = self.handler_threads.coroutine(callback)
        timer = PeriodicTimer(self._clock, self._clock, period, callback)
        timer.start()
        return timer

    async def time_ns(self) -> int:
        return await self.api.time_ns()

    def __repr__(self) -> str:
        return f"<Robot {self.url} {'connected' if self.connected else 'not connected'}>"

    # -- beginning -------------------------------------------------------------------------------------------

    async def identify(self, ros_version: int | None, fetch_types: bool) -> None:
        """Ask for the robot's distribution and types. Does not fail, because there may be no rosapi."""
        distro = await self._ask_distro() if ros_version is None else closest_distro("", ros_version)
        self.types.set_distro(distro)
        self.types.is_reported = ros_version is None and distro is not None
        if fetch_types and distro is not None:
            try:
                await self.types.refresh()
            except UNANSWERED as error:
                logger.info("the robot does not tell its types: %s", error)

    async def _ask_distro(self) -> Distro | None:
        """Return None without rosapi; rosapi of ROS 1 often lacks this question."""
        try:
            found = await self._identifying.ros_version()
        except CallTimeout:
            logger.info("the robot does not answer rosapi's questions: its version of ROS is not known")
            return None
        except UNANSWERED:
            try:
                await self._identifying.time_ns()
            except UNANSWERED:
                logger.info("the robot has no rosapi: its version of ROS is not known")
                return None
            return NOETIC
        return closest_distro(found.distro, found.version) if found.version else None

    # -- parts -----------------------------------------------------------------------------------------------

    def _dispatcher(self) -> Dispatcher[None]:
        return Dispatcher(
            {
                # Published messages and status messages are handled by the session.
                Publish: lambda _, op: None,
                Status: lambda _, op: None,
                ServiceResponse: self._on_response,
                CallService: lambda _, op: self._services.find(op.service).on_call(op),
                ActionFeedback: self._on_goal_op,
                ActionResult: self._on_goal_op,
                SendActionGoal: lambda _, op: self._actions.find(op.action).on_goal(op),
                CancelActionGoal: lambda _, op: self._actions.find(op.action).on_cancel(op),
            },
            _log_failure,
            (ServiceFailed, InvalidMessage),
            Direction.TO_CLIENT,
        )

    def _on_response(self, _: None, op: ServiceResponse) -> None:
        if isinstance(sent := self._session.find(op.id), WireCall):
            sent.receive(op)
        else:
            logger.debug("an answer of %s comes too late or was not asked for", op.service)

    def _on_goal_op(self, _: None, op: ActionFeedback | ActionResult) -> None:
        if isinstance(sent := self._session.find(op.id), WireGoal):
            sent.receive(op)

    async def _ask(self, timeout: float | None, question: str, args: Mapping[str, object]) -> Any:
        request = RawJson(msgspec.json.encode(args))
        answer = await call_service(self._session, f"{_ROSAPI}/{question}", request, timeout)
        try:
            return answer.plain()
        except MalformedPayload as error:
            raise ServiceFailed(f"the answer of {_ROSAPI}/{question} cannot be read: {error}") from None

    def _patience(self, timeout: Timeout) -> float | None:
        return self._timeout if timeout is USUAL else timeout


class _ClientClock:
    """Clock of this computer, with timers on the connection's event loop.

    Satisfies :class:`rwt_participant.timers.RobotClock` and :class:`rwt_participant.timers.TimerLoop`.
    """

    def __init__(self, tasks: TaskStarter) -> None:
        self._tasks = tasks

    def monotonic(self) -> float:
        """Return `time.monotonic`, which works in callbacks of sockets, too."""
        return time.monotonic()

    async def sleep(self, seconds: float) -> None:
        await anyio.sleep(seconds)

    def within(self, seconds: float | None) -> AbstractContextManager[object]:
        return anyio.move_on_after(seconds)

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        return _TimerTask(self._tasks, delay, call)

    def soon(self, call: Callable[[], None]) -> None:
        """Run a plain function at once: a client is used on its loop's thread only."""
        call()

    def spawn(self, function: Callable[[], Awaitable[None]], name: str) -> None:
        async def run() -> None:
            try:
                await function()
            except Exception:
                logger.exception("a %s's callback failed", name)

        self._tasks.start_soon(run)


class _TimerTask(Timer):
    """Delayed call, in a task of its own."""

    def __init__(self, tasks: TaskStarter, delay: float, call: Callable[[], None]) -> None:
        self._delay = delay
        self._call: Callable[[], None] | None = call
        self._scope: anyio.CancelScope | None = None
        tasks.start_soon(self._run)

    async def _run(self) -> None:
        with anyio.CancelScope() as self._scope:
            await anyio.sleep(self._delay)
            call, self._call = self._call, None
            if call is not None:
                call()

    def cancel(self) -> None:
        self._call = None
        if self._scope is not None:
            self._scope.cancel()


def _log_failure(_: None, op: Op, error: Exception) -> None:
    logger.error("a %s of the server could not be handled", op.op, exc_info=error)
