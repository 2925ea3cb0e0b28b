"""Services of other processes, as far as they have been discovered."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Generic, TypeVar

from rwt_participant.errors import ProviderGone

if TYPE_CHECKING:
    from rwt_graph.api import ServiceInfo
    from rwt_graph.memory.services import MemoryCall
    from rwt_graph.memory.tables import Changes

T = TypeVar("T")


@dataclass(eq=False, slots=True)
class RemoteService(Generic[T]):
    """Service that one or more other processes offer.

    Attributes:
        open: pending calls.
        offers: providers by key, the oldest first, each with the backend's own description.
    """

    open: set[MemoryCall] = field(default_factory=set)
    offers: dict[Hashable, tuple[ServiceInfo, T]] = field(default_factory=dict)

    @property
    def first(self) -> tuple[ServiceInfo, T]:
        """Return the oldest provider, which determines type and node of the service."""
        return next(iter(self.offers.values()))

    def lose(self, why: str) -> None:
        """End the pending calls with :exc:`ProviderGone`."""
        while self.open:
            self.open.pop().end_with(ProviderGone(why))


class RemoteServiceTable(Generic[T]):
    """Services of other processes, by name."""

    def __init__(self, changes: Changes) -> None:
        self._changes = changes
        self._services: dict[str, RemoteService[T]] = {}

    def found(self, key: Hashable, info: ServiceInfo, description: T) -> None:
        """Add a provider."""
        service = self._services.setdefault(info.name, RemoteService())
        service.offers[key] = (info, description)
        self._changes.note()

    def lost(self, key: Hashable, name: str) -> None:
        """Remove a provider; with the last one of a service, its pending calls end."""
        service = self._services.get(name)
        if service is None or service.offers.pop(key, None) is None:
            return
        self._changes.note()
        if not service.offers:
            del self._services[name]
            service.lose(f"Service {name} was unadvertised")

    def close(self) -> None:
        """End all pending calls."""
        for service in tuple(self._services.values()):
            service.lose("the connection to it was closed")

    def get(self, name: str) -> RemoteService[T] | None:
        """Return a service; None if no other process offers it."""
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
