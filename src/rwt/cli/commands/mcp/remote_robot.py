"""A connection to a robot, as the robot that an agent's tools use."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Final

import anyio

from rwt.cli.verbs import gather
from rwt.gateways.mcp.errors import ToolError
from rwt.gateways.mcp.robot import Named, Robot
from rwt_client import ConnectionEvent, ServerRefused
from rwt_client import Robot as Connection
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.errors import RobotError, UnknownType
from rwt_participant.goals import Goal
from rwt_participant.handles import Handle, Publisher
from rwt_participant.messages import Message, MessageCallback, MessageLike
from rwt_participant.transforms import Transforms

_TAKE_LEASE: Final = "/gate/take_lease"


class RemoteRobot(Robot):
    """A robot elsewhere; its server decides what this client may do.

    Args:
        connection: to it.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self.params = connection.params

    @property
    def tf(self) -> Transforms:  # noqa: D102 - inherited
        return self._connection.tf

    async def topics(self) -> tuple[Named, ...]:  # noqa: D102 - inherited
        return tuple(sorted(Named(each.name, each.type) for each in await self._connection.api.topics()))

    async def services(self) -> tuple[Named, ...]:  # noqa: D102 - inherited
        names = await self._connection.api.services()
        return await _typed(names, self._connection.types.of_service)

    async def actions(self) -> tuple[Named, ...]:  # noqa: D102 - inherited
        names = await self._connection.api.action_servers()
        return await _typed(names, self._connection.types.of_action)

    async def type_of(self, topic: str) -> MessageType:  # noqa: D102 - inherited
        types = self._connection.types
        return await types.message(await types.of_topic(topic))

    async def interface(self, name: str) -> MessageType | ServiceType | ActionType:  # noqa: D102 - inherited
        types = self._connection.types
        known = types.known_message(name) or types.known_service(name) or types.known_action(name)
        if known is not None:
            return known
        for fetch in (types.message, types.service, types.action):
            try:
                return await fetch(name)
            except UnknownType:
                continue
        raise UnknownType(f"no message, service or action of the name {name} is known")

    def subscribe(self, topic: str, callback: MessageCallback, type: str) -> Handle:  # noqa: D102 - inherited
        return self._connection.subscribe(topic, callback, type)

    def advertise(self, topic: str, type: str) -> Publisher:  # noqa: D102 - inherited
        return _HeardPublisher(self._connection, topic, type)

    async def call(self, service: str, request: MessageLike, seconds: float) -> Message:  # noqa: D102 - inherited
        return await self._connection.call(service, request, timeout=seconds)

    async def send_goal(  # noqa: D102 - inherited
        self, action: str, goal: MessageLike, on_feedback: Callable[[Message], object]
    ) -> Goal:
        return await self._connection.send_goal(action, goal, on_feedback=on_feedback)

    def cancel_goal(self, goal: Goal) -> None:  # noqa: D102 - inherited
        goal.cancel()

    async def pass_gate(self, seconds: float = 0.0) -> bool:  # noqa: D102 - inherited
        return False  # Its server asks whoever may give it.

    async def take_lease(self, topic: str) -> float | None:  # noqa: D102 - inherited
        if _TAKE_LEASE not in await self._connection.api.services():
            return None  # A gate shows its services to every role.
        answer = await self._connection.call(_TAKE_LEASE, {"topic": topic}, "rwt_gate_msgs/Lease")
        if answer.seconds and not answer.success:
            raise ToolError(answer.message)
        return answer.seconds or None

    async def time_ns(self) -> int:  # noqa: D102 - inherited
        return await self._connection.time_ns()

    def monotonic(self) -> float:  # noqa: D102 - inherited
        return time.monotonic()

    async def sleep(self, seconds: float) -> None:  # noqa: D102 - inherited
        await anyio.sleep(seconds)

    def within(self, seconds: float | None) -> AbstractContextManager[object]:  # noqa: D102 - inherited
        return anyio.move_on_after(seconds)


class _HeardPublisher(Publisher):
    """A publisher that raises what the server says of its messages: rosbridge tells of a refusal later, and
    of no message in particular. Of two that publish meanwhile both hear it.

    Args:
        connection: to the robot.
        topic: where it publishes.
        type: of the messages.
    """

    def __init__(self, connection: Connection, topic: str, type: str) -> None:
        self._connection = connection
        self._publisher = connection.advertise(topic, type)
        self._refusal = ""
        self._listening = connection.on_event(self._hear)
        self.name = self._publisher.name

    def _hear(self, event: ConnectionEvent) -> None:
        if event.kind == "status" and event.level == "error" and event.text.startswith("publish: "):
            self._refusal = event.text

    async def ready(self) -> None:
        await self._publisher.ready()

    def publish(self, message: MessageLike) -> None:
        self._publisher.publish(message)
        self._raise_refusal()

    def _raise_refusal(self) -> None:
        if self._refusal:
            raise ServerRefused(self._refusal)

    async def __aexit__(self, *exc: object) -> None:
        try:
            if exc[0] is None:
                # What is said of the messages comes before the answer to what is asked after them.
                await self._connection.time_ns()
                self._raise_refusal()
        finally:
            self.close()

    def close(self) -> None:
        self._listening()
        self._publisher.close()


async def _typed(names: Sequence[str], type_of: Callable[[str], Awaitable[str]]) -> tuple[Named, ...]:
    """Names with their types, which are asked for one by one; empty where the robot does not tell."""

    async def ask(name: str) -> Named:
        try:
            return Named(name, await type_of(name))
        except RobotError:
            return Named(name)

    return tuple(await gather([partial(ask, name) for name in sorted(names)]))
