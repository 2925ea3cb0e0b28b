"""Services and actions that the clients of one bridge provide, and their pending requests.

Some clients, such as rosbridgecpp, open a new connection for each response, so a response is accepted over
any connection from the same address and role.
"""

from __future__ import annotations

from typing import Generic, TypeVar

from rwt.access.client_graph import ClientGraph
from rwt.rosbridge.reply import Replies
from rwt_graph.names import resolve
from rwt_protocol.dispatcher import Steps
from rwt_protocol.errors import Refused

T = TypeVar("T")


class Provided(Generic[T]):
    """Service or action that a client provides, with its unanswered requests by id."""

    __slots__ = ("_count", "_name", "_replies", "address", "name", "pending", "role")

    def __init__(self, name: str, graph: ClientGraph, address: str, replies: Replies) -> None:
        self._name = name  # In the client's spelling.
        self._replies = replies
        self._count = 0
        self.name = resolve(name)
        self.address = address
        self.role = graph.role.name  # Distribution at the time of advertising.
        self.pending: dict[str, T] = {}

    def _add(self, kind: str, request: T) -> str:
        self._count += 1
        id_ = f"{kind}:{self._name}:{self._count}"
        self.pending[id_] = request
        return id_

    def _end(self, id_: str) -> None:
        self.pending.pop(id_, None)


Offers = dict[str, list[Provided[T]]]
"""Services, or actions, that all clients of one bridge provide, by absolute name."""


class PeerOffers(Generic[T]):
    """Services, or actions, that one client provides."""

    __slots__ = ("_address", "_graph", "_offers", "_own")

    def __init__(self, graph: ClientGraph, address: str, offers: Offers[T]) -> None:
        self._graph = graph
        self._address = address
        self._offers = offers
        self._own: dict[str, Provided[T]] = {}

    def add(self, provided: Provided[T]) -> None:
        """Add an advertised service or action, in place of the client's own of that name."""
        self.discard(provided.name)
        self._own[provided.name] = provided
        self._offers.setdefault(provided.name, []).append(provided)

    def discard(self, name: str) -> None:
        """Remove what was withdrawn; idempotent."""
        provided = self._own.pop(name, None)
        if provided is not None:
            offers = self._offers[name]
            offers.remove(provided)
            if not offers:
                del self._offers[name]

    def close(self) -> Steps:
        """Remove everything."""
        for name in tuple(self._own):
            self.discard(name)
            yield

    def pending(self, op: str, name: str, id: str | int | None, what: str) -> dict[str, T]:
        """Return the pending requests that contain `id`, possibly advertised over another connection.

        Args:
            name: service or action, as the client spells it.
            what: description of such a request, for the error.

        Raises:
            Refused: no such request is pending.
            NotAllowed: the role may not provide anything of that name (any more).
        """
        absolute = resolve(name)
        own = self._own.get(absolute)
        if isinstance(id, str):
            if own is not None and id in own.pending:
                return own.pending
            for other in self._offers.get(absolute, ()):
                if id in other.pending and (other.address, other.role) == (
                    self._address,
                    self._graph.role.name,
                ):
                    self._graph.require("provide", absolute)
                    return other.pending
        if own is None:
            raise Refused(f"{op}: this client does not advertise {name}")
        raise Refused(f"{op}: {what} under id {id!r}", level="warning")
