"""Handles of a robot program: publishers, subscriptions, services and actions that it offers."""

from __future__ import annotations

import inspect
import logging
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Generator
from typing import Any, Final, Generic, Self, TypeVar

import anyio

from rwt_participant.errors import HandleClosed, InvalidMessage, RobotError, TimedOut
from rwt_participant.future import Within
from rwt_participant.messages import Message, MessageCallback, MessageLike, is_coroutine_function

logger = logging.getLogger(__name__)

T = TypeVar("T")

QUEUE_BYTES: Final = 64 * 1024 * 1024
"""Default of `queue_bytes`: maximum bytes of messages that are queued for a coroutine or an iterator."""


class Handle(ABC):
    """Publisher, subscription or server, until :meth:`close` or the end of its ``with`` or ``async with``.

    A handle can be used at once. ``await`` waits until its type is known, and raises the error if it is not.

    Attributes:
        name: name of the topic, service or action.
    """

    name: str

    async def ready(self) -> None:  # noqa: B027 - optional: handles of a node are ready at once
        """Wait until it is in use.

        Raises:
            UnknownType: its type is not known.
            NotFound: no type is given, and there is no such topic with a type.
            ConnectionLost: there will be no connection any more.
        """

    @abstractmethod
    def close(self) -> None:
        """Release it. No-op if it is closed."""

    async def _when_ready(self) -> Self:
        await self.ready()
        return self

    def __await__(self) -> Generator[Any, None, Self]:
        return self._when_ready().__await__()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        try:
            await self.ready()
        except BaseException:
            self.close()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        self.close()


class Publisher(Handle):
    """Publishes on one topic."""

    @abstractmethod
    def publish(self, message: MessageLike) -> None:
        """Publish one message; does not wait.

        Args:
            message: a :data:`~rwt_participant.messages.MessageLike`. Missing fields get their defaults, a
                header without a stamp the time.

        Raises:
            InvalidMessage: it does not fit the topic's type.
            HandleClosed: this publisher or its node was closed.
        """


class MessageQueue(Generic[T]):
    """Newest messages of a subscription, bounded in number and bytes, for one coroutine that takes them.

    Args:
        topic: topic of the messages, for the log.
        size: maximum number of queued messages, at least 1.
        most_bytes: maximum bytes of queued messages; the newest is queued whatever its size.

    Attributes:
        dropped: messages that were dropped for newer ones.
    """

    def __init__(self, topic: str, size: int, most_bytes: int) -> None:
        self.dropped = 0
        self._topic = topic
        self._most = max(1, size)
        self._most_bytes = most_bytes
        self._messages: deque[tuple[T, int]] = deque()
        self._bytes = 0
        # Events can be created in tasks only, so the waiting coroutine creates it.
        self._awake: anyio.Event | None = None
        self._has_warned = False

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: T, size: int) -> None:
        """Queue a message of `size` bytes; drop the oldest ones beyond the limits."""
        messages = self._messages
        self._bytes += size
        while messages and (len(messages) >= self._most or self._bytes > self._most_bytes):
            if len(messages) < self._most and not self._has_warned:
                self._has_warned = True
                logger.warning(
                    "messages of %s are dropped: more than %d bytes wait for their subscriber;"
                    " `queue_bytes` of what subscribes allows more",
                    self._topic,
                    self._most_bytes,
                )
            self._bytes -= messages.popleft()[1]
            self.dropped += 1
        messages.append((message, size))
        self.wake()

    def pop(self) -> T:
        message, size = self._messages.popleft()
        self._bytes -= size
        return message

    def clear(self) -> None:
        self._messages.clear()
        self._bytes = 0

    def wake(self) -> None:
        """Let :meth:`wait` return."""
        awake, self._awake = self._awake, None
        if awake is not None:
            awake.set()

    async def wait(self) -> None:
        """Wait for a message, or for :meth:`wake`."""
        if self._awake is None:
            self._awake = anyio.Event()
        await self._awake.wait()


class Subscription(Handle):
    """Messages of one topic, which are passed to a callback, or queued for an iterator.

    A subclass passes messages to a plain callback at once, and queues them otherwise.
    """

    #: Errors after which an iteration ends; any other is raised.
    _ends: tuple[type[RobotError], ...] = (HandleClosed,)

    def __init__(
        self, name: str, callback: MessageCallback | None, queue_size: int, queue_bytes: int, within: Within
    ) -> None:
        self.name = name
        self._callback = callback
        self._queue: MessageQueue[Any] | None = None
        if callback is None or is_coroutine_function(callback):
            self._queue = MessageQueue(name, queue_size, queue_bytes)
        self._within = within
        self._error: RobotError | None = None

    @property
    def dropped(self) -> int:
        """Number of messages that were dropped because they were not taken in time."""
        return 0 if self._queue is None else self._queue.dropped

    async def get(self, timeout: float | None = None) -> Message:
        """Return the next message.

        Args:
            timeout: seconds; None waits without limit.

        Raises:
            TimedOut: none arrived in time.
            HandleClosed: the subscription was closed.
            UnknownType: of a client: the topic's type is not known; NotFound: the topic does not exist.
            ServerRefused: of a client: the server rejects the subscription; with its text.
            ConnectionLost: of a client: there will be no connection any more.
            RuntimeError: the subscription has a callback, which receives the messages.
        """
        with self._within(timeout):
            return await self._next(self._iterable())
        raise TimedOut(f"no message came on {self.name} within {timeout:g} s")

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Message:
        try:
            return await self._next(self._iterable())
        except self._ends:
            raise StopAsyncIteration from None

    @abstractmethod
    def _read(self, queued: Any) -> Message | None:
        """Return the message of what was queued; None if it is to be skipped."""

    def _iterable(self) -> MessageQueue[Any]:
        if self._queue is None or self._callback is not None:
            raise RuntimeError(f"the subscription to {self.name} has a callback: use `topic` to iterate")
        return self._queue

    async def _next(self, queue: MessageQueue[Any]) -> Message:
        while True:
            while queue:
                message = self._read(queue.pop())
                if message is not None:
                    return message
            if self._error is not None:
                raise self._error
            await queue.wait()

    async def _call_in_turn(self, queue: MessageQueue[Any], callback: MessageCallback) -> None:
        while True:
            try:
                message = await self._next(queue)
            except InvalidMessage as error:
                logger.error("a message of %s is dropped: %s", self.name, error)
                continue
            except RobotError as error:
                if not isinstance(error, self._ends):
                    logger.warning("the subscriber of %s receives nothing more: %s", self.name, error)
                return
            try:
                returned = callback(message)
                if inspect.isawaitable(returned):
                    await returned
            except Exception:
                logger.exception("a subscriber of %s failed", self.name)

    def _end(self, error: RobotError) -> None:
        """End the messages because of `error`; those that are queued are dropped if that is HandleClosed."""
        self._error = self._error or error
        if self._queue is not None:
            if isinstance(error, HandleClosed):
                self._queue.clear()
            self._queue.wake()
