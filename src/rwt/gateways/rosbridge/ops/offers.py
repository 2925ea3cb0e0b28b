"""Services and actions that the clients of one bridge provide, and their pending requests.

Some clients, such as rosbridgecpp, open a new connection for each response, so a response is accepted over
any connection from the same address and role.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from rwt_graph.names import resolve

if TYPE_CHECKING:
    from rwt.access.client_graph import ClientGraph

T = TypeVar("T")


class Offer(Generic[T]):
    """Service or action that a client provides.

    Attributes:
        name: absolute name.
        address: the client's.
        role: the name of the client's role when it offered it.
        pending: what the client was asked and has not answered, by the id of the question.
    """

    __slots__ = ("address", "name", "pending", "role")

    def __init__(self, name: str, graph: ClientGraph, address: str) -> None:
        self.name = resolve(name)
        self.address = address
        self.role = graph.role.name
        self.pending: dict[str, T] = {}


class Offers(Generic[T]):
    """The services, or the actions, that all clients of one bridge offer."""

    def __init__(self) -> None:
        self._offers: dict[str, list[Offer[T]]] = {}

    def add(self, offer: Offer[T]) -> None:
        """Add an offer."""
        self._offers.setdefault(offer.name, []).append(offer)

    def remove(self, offer: Offer[T]) -> None:
        """Remove an offer that was withdrawn."""
        offers = self._offers[offer.name]
        offers.remove(offer)
        if not offers:
            del self._offers[offer.name]

    def asked(self, name: str, id_: str, graph: ClientGraph, address: str) -> Offer[T] | None:
        """Return the offer whose client received request `id_`, for a response over another connection.

        Args:
            name: absolute name of the service or action.
            id_: under which the client was asked.
            graph: the graph as whoever answers may see it.
            address: of whoever answers: the one that offers must have the same, and the same role.

        Raises:
            NotAllowed: the role may not provide anything of that name (any more).
        """
        for offer in self._offers.get(name, ()):
            if id_ in offer.pending and offer.address == address and offer.role == graph.role.name:
                graph.require("provide", name)
                return offer
        return None
