"""Handles of a client: in use once their type is known, and again on each new connection."""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Self, TypeVar

from rwt_participant.errors import RobotError, UnknownType
from rwt_participant.future import Future
from rwt_participant.handles import Handle

if TYPE_CHECKING:
    from rwt_client.endpoints.remote_types import RemoteTypes
    from rwt_client.errors import ConnectionLost
    from rwt_client.wire.session import ReconnectingSession
    from rwt_protocol.ops import Op
    from rwt_transports.background import TaskStarter

logger = logging.getLogger("rwt_client")

T = TypeVar("T")


@dataclass(slots=True)
class ClientConnection:
    """Connection of a client, as its endpoints use it.

    Attributes:
        drained: waits until the network has taken everything that was sent.
        timeout: default timeout of calls, in seconds; None waits without limit.
        cbor_offered: True if the transport carries CBOR (TCP-05), and the server has not rejected it.
    """

    session: ReconnectingSession
    types: RemoteTypes
    tasks: TaskStarter
    drained: Callable[[], Awaitable[None]]
    timeout: float | None
    cbor_offered: bool


class RemoteHandle(Handle, Generic[T]):
    """Handle of a client that is restored on each new connection.

    Attributes:
        closed: True if this program has closed it.
    """

    def __init__(self, connection: ClientConnection, kind: str, name: str) -> None:
        self.name = name
        self.id = connection.session.next_id(kind, name)
        self._connection = connection
        self._session = connection.session
        self._type: T | None = None
        self.closed = False
        self._opened: Future[None] = Future()

    @property
    def type(self) -> T:
        """Type of the endpoint. Raises UnknownType until the robot has answered: await the handle first."""
        if self._type is None:
            raise UnknownType(f"the type of {self.name} is not known yet: await what is held of it first")
        return self._type

    def open(self, known: T | None, ask: Callable[[], Awaitable[T]]) -> Self:
        """Open the handle with the known type, or once the robot has answered.

        Raises:
            ConnectionLost: there will be no connection any more.
        """
        if known is None:
            self._connection.tasks.start_soon(self._ask, ask)
        else:
            self._begin(known)
        return self

    async def ready(self) -> None:
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

    def close(self) -> None:
        if self.closed:
            return
        self.closed = True
        self.release()
        self._session.remove(self.id)
        if self._type is not None:
            self._session.send_if_connected(self.withdrawal())

    def release(self) -> None:
        """Release local resources; called once, by `close`."""

    @abstractmethod
    def withdrawal(self) -> Op:
        """Return the op that withdraws it from the server."""

    def take_type(self, type: T) -> None:
        """Prepare what depends on the type."""

    def opened(self) -> None:
        """Called once, on first use."""

    @abstractmethod
    def restore(self) -> None:
        """Request it on a new connection."""

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """Called when the connection is lost; `final`: there will not be another."""
        if final:
            self.fail(error)

    @abstractmethod
    def refused(self, text: str) -> None:
        """Called when the server rejects what was sent under the id."""

    @abstractmethod
    def fail(self, error: RobotError) -> None:
        """End it because of `error`."""
