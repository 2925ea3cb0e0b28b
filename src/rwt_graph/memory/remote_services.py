"""Services of other processes, as far as they have been discovered."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import Generic, TypeVar

from rwt_graph.api import ServiceInfo
from rwt_graph.memory.services import MemoryCall, Services
from rwt_graph.names import is_for_clients
from rwt_participant.errors import ProviderGone

T = TypeVar("T")


class RemoteService(Generic[T]):
    """Service that one or more other processes offer.

    Attributes:
        open: pending calls of all providers that are present.
        offers: providers by key, the oldest first, each with the backend's own description.
    """

    def __init__(self) -> None:
        self.offers: dict[Hashable, tuple[ServiceInfo, T]] = {}
        self.open: set[MemoryCall] = set()
        # Pending calls, with the providers that may have received them: later ones have not.
        self._asked: list[tuple[set[MemoryCall], set[Hashable]]] = []

    @property
    def first(self) -> tuple[ServiceInfo, T]:
        """Return the oldest provider, which determines type and node of the service."""
        return next(iter(self.offers.values()))

    def add(self, key: Hashable, info: ServiceInfo, description: T) -> None:
        self.offers[key] = (info, description)
        self._asked = [entry for entry in self._asked if entry[0]]
        self.open = set()
        self._asked.append((self.open, set(self.offers)))

    def remove(self, key: Hashable, why: str, node: str = "") -> bool:
        """Remove a provider; end the calls that no other provider has received. False if it is unknown."""
        if self.offers.pop(key, None) is None:
            return False
        for calls, providers in tuple(self._asked):
            providers.discard(key)
            if not providers:
                _end(calls, why, node)
        return True

    def lose(self, why: str) -> None:
        for calls, _ in self._asked:
            _end(calls, why)


def _end(calls: set[MemoryCall], why: str, node: str = "") -> None:
    while calls:
        gone = ProviderGone(why)
        gone.node = node
        calls.pop().end_with(gone)


class RemoteServiceTable(Generic[T]):
    """Services of other processes, by name.

    Args:
        services: services of this process; those of clients are displaced by the robot's.
    """

    def __init__(self, services: Services) -> None:
        self._changes = services.changes
        self._local = services
        self._services: dict[str, RemoteService[T]] = {}

    def found(self, key: Hashable, info: ServiceInfo, description: T) -> None:
        self._services.setdefault(info.name, RemoteService()).add(key, info, description)
        self._changes.note()
        if not is_for_clients(info.node):
            self._local.robot_offers(info.name)

    def lost(self, key: Hashable, name: str, node: str = "") -> None:
        """Remove a provider, and end the calls that no other one has received.

        Args:
            node: node that left with it, if any.
        """
        service = self._services.get(name)
        if service is None:
            return
        if len(service.offers) == 1 and key in service.offers:
            del self._services[name]  # First: callers whose calls end may call again.
        why = f": its node {node} left" if node else ""
        if service.remove(key, f"Service {name} was unadvertised{why}", node):
            self._changes.note()

    def close(self) -> None:
        for service in tuple(self._services.values()):
            service.lose("the connection to it was closed")

    def get(self, name: str) -> RemoteService[T] | None:
        return self._services.get(name)

    def info(self, name: str) -> ServiceInfo | None:
        service = self._services.get(name)
        return None if service is None else service.first[0]

    def names(self) -> set[str]:
        return set(self._services)

    def by_node(self) -> Iterator[tuple[str, str]]:
        for name, service in self._services.items():
            for info, _ in service.offers.values():
                yield info.node, name
