"""What a program holds of the robot until it lets go: publishers, subscriptions, what it serves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator
from typing import Any, Final, Self

from rwt_participant.messages import Message, MessageLike

QUEUE_BYTES: Final = 64 * 1024 * 1024
"""Bytes of messages that wait for a coroutine or an iterator, unless `queue_bytes` says another number."""


class Handle(ABC):
    """Something that lasts until :meth:`close`, or the end of its ``with`` or ``async with``.

    It may be used as soon as it is made. It need not be awaited; ``await`` waits until its type is known, and
    raises what is wrong with it.

    Attributes:
        name: of the topic, service or action.
    """

    name: str

    async def ready(self) -> None:  # noqa: B027 - a node's are in use as soon as they are made
        """Wait until it is in use.

        Raises:
            UnknownType: its type is not known.
            NotFound: no type was given, and there is no such topic that has one.
            ConnectionLost: there will be no connection any more.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of it. May be called twice."""

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
            message: a :data:`~rwt_participant.messages.MessageLike`. What is missing gets its default, a
                header without a stamp the time.

        Raises:
            InvalidMessage: it does not fit the topic's type.
        """


class Subscription(Handle):
    """The messages of one topic, to iterate over unless they go to a callback."""

    @property
    @abstractmethod
    def dropped(self) -> int:
        """Messages that were dropped because nothing took them in time."""

    @abstractmethod
    async def get(self, timeout: float | None = None) -> Message:
        """The next message.

        Args:
            timeout: seconds; None waits as long as it takes.

        Raises:
            TimedOut: none came in time.
            HandleClosed: the subscription was closed.
            ConnectionLost: there will be no connection any more.
        """

    def __aiter__(self) -> Self:
        return self

    @abstractmethod
    async def __anext__(self) -> Message: ...
