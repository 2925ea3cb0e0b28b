"""What a client holds at the server: put to use once its type is known, and again on each new connection."""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Generic, Self, TypeVar

from rwt_program.errors import RobotError, UnknownType
from rwt_program.future import Future
from rwt_program.handles import Handle

if TYPE_CHECKING:
    from rwt_client.errors import ConnectionLost
    from rwt_client.wire.session import ReconnectingSession
    from rwt_transports.background import TaskStarter

logger = logging.getLogger("rwt_client")

T = TypeVar("T")


class RemoteHandle(Handle, Generic[T]):
    """A handle of a client, which is restorable (:class:`rwt_client.wire.session.Restorable`).

    Attributes:
        name: the topic, service or action.
        id: its id on the wire.
    """

    def __init__(self, session: ReconnectingSession, kind: str, name: str) -> None:
        self.name = name
        self.id = session.next_id(kind, name)
        self._session = session
        self._type: T | None = None
        self._opened: Future[None] = Future()

    @property
    def type(self) -> T:
        """Its type. Raises UnknownType while the robot is still asked for it: await the handle first."""
        if self._type is None:
            raise UnknownType(f"the type of {self.name} is not known yet: await what is held of it first")
        return self._type

    def open(self, known: T | None, ask: Callable[[], Awaitable[T]], tasks: TaskStarter) -> Self:
        """Put it to use with the type that is known, or else once the robot has said what it is.

        Raises:
            ConnectionLost: there will be no connection any more.
        """
        if known is None:
            tasks.start_soon(self._ask, ask)
        else:
            self._begin(known)
        return self

    async def ready(self) -> None:
        """Wait until its type is known; see :meth:`Handle.ready`."""
        await self._opened.wait()

    async def _ask(self, ask: Callable[[], Awaitable[T]]) -> None:
        try:
            self._begin(await ask())
        except RobotError as error:
            if not self._opened.awaited:
                logger.error("%s is not in use: %s", self.name, error)
            self.fail(error)
            self._opened.set(error)

    def _begin(self, type: T) -> None:
        if self.closed:
            self._opened.set(None)
            return
        self._session.add(self.id, self)
        self._type = type
        self.take_type(type)
        if self._session.connected:
            self.restore()
        self.opened()
        self._opened.set(None)

    @property
    @abstractmethod
    def closed(self) -> bool:
        """Whether this program has closed it."""

    @abstractmethod
    def take_type(self, type: T) -> None:
        """Prepare what depends on the type."""

    def opened(self) -> None:
        """It is in use for the first time."""

    @abstractmethod
    def restore(self) -> None:
        """Say on a new connection what is wanted."""

    @abstractmethod
    def lost(self, error: ConnectionLost, final: bool) -> None:
        """The connection is gone; `final`: there will not be another."""

    @abstractmethod
    def refused(self, text: str) -> None:
        """The server complains of what was said under the id."""

    @abstractmethod
    def fail(self, error: RobotError) -> None:
        """It will not be in use any more, because of `error`."""
