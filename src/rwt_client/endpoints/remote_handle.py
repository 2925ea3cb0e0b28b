"""What a client holds at the server: put to use once its type is known, and again on each new connection."""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Generic, Self, TypeVar

from rwt_participant.errors import RobotError, UnknownType
from rwt_participant.future import Future
from rwt_participant.handles import Handle

if TYPE_CHECKING:
    from rwt_client.errors import ConnectionLost
    from rwt_client.wire.session import ReconnectingSession
    from rwt_protocol.ops import Op
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


class RemoteServer(RemoteHandle[T]):
    """Something that this program offers until it closes it, or offers another by the same name.

    Args:
        wire_name: what the server calls a type.
        offered: everything of this kind that this program offers, by name.
    """

    def __init__(
        self,
        session: ReconnectingSession,
        kind: str,
        name: str,
        wire_name: Callable[[T], str],
        offered: dict[str, Self],
    ) -> None:
        super().__init__(session, kind, name)
        self._wire_name = wire_name
        self._offered = offered
        self._closed = False
        previous = offered.get(name)
        if previous is not None:
            previous.close()
        offered[name] = self

    @property
    def closed(self) -> bool:
        """Whether this program has closed it."""
        return self._closed

    def close(self) -> None:
        """Withdraw it; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        if self._offered.get(self.name) is self:
            del self._offered[self.name]
        self._session.remove(self.id)
        if self._type is not None:
            self._session.send_if_connected(self.unadvertise())

    def take_type(self, type: T) -> None:
        """Nothing more depends on the type."""

    def restore(self) -> None:
        """Advertise on a new connection."""
        self._session.send(self.advertise(self._wire_name(self.type)))

    def fail(self, error: RobotError) -> None:
        """It is not offered, because of `error`."""
        self.close()

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """The connection is gone: the server has said so to all that call."""

    def refused(self, text: str) -> None:
        """The server does not take it."""
        logger.error("%s is not offered: %s", self.name, text)

    @abstractmethod
    def advertise(self, wire_type: str) -> Op:
        """The op that offers it."""

    @abstractmethod
    def unadvertise(self) -> Op:
        """The op that withdraws it."""
