"""Common parts of the tables: changes and cached listings, resources of nodes, and providers by name."""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections.abc import Callable, Iterator
from functools import partial
from typing import Generic, Protocol, TypeVar

from rwt_graph.api import OnDisplaced, Registration

logger = logging.getLogger(__name__)

T = TypeVar("T")


class Displaceable(Protocol):
    """Endpoint that can be displaced: a publisher, subscription, service or action."""

    on_displaced: OnDisplaced | None

    def close(self) -> None:
        """Close it."""


def displace(endpoint: Displaceable, reason: str) -> None:
    """Close an endpoint of a node for clients because of the robot, and report the reason once."""
    on_displaced, endpoint.on_displaced = endpoint.on_displaced, None
    endpoint.close()
    if on_displaced is not None:
        try:
            on_displaced(reason)
        except Exception:
            logger.exception("the holder of a displaced endpoint failed")


class Changes:
    """Counter of changes to the listings of a graph."""

    __slots__ = ("count",)

    def __init__(self) -> None:
        self.count = 0

    def note(self) -> None:
        self.count += 1


class NodeResources:
    """Resources of one node, each with the function that releases it.

    Attributes:
        private: True if the node and its endpoints are hidden from other processes.
        for_clients: True if the node acts for clients of a server: the robot displaces what it holds.
    """

    def __init__(self, name: str, *, private: bool = False, for_clients: bool = False) -> None:
        self.name = name
        self.private = private
        self.for_clients = for_clients
        self._release: dict[object, Callable[[], None]] = {}

    def __len__(self) -> int:
        return len(self._release)

    def add(self, resource: object, release: Callable[[], None]) -> None:
        """Add a resource; `release` must end in a :meth:`drop`."""
        self._release[resource] = release

    def drop(self, resource: object) -> None:
        self._release.pop(resource, None)

    def release_all(self) -> None:
        """Release every resource, the newest first."""
        while self._release:
            _, release = self._release.popitem()
            release()


class PerNode(Generic[T]):
    """Resources of nodes, one for each node and name: made on first use, closed when the node leaves.

    Args:
        close: closes a resource.

    Attributes:
        made: resources by node and name.
    """

    def __init__(self, close: Callable[[T], None]) -> None:
        self.made: dict[tuple[NodeResources, str], T] = {}
        self._close = close

    def get(self, owner: NodeResources, name: str, make: Callable[[], T]) -> T:
        found = self.made.get((owner, name))
        if found is None:
            found = self.made[owner, name] = make()
            owner.add(found, partial(self.close, owner, name))
        return found

    def close(self, owner: NodeResources, name: str) -> None:
        """Close a resource; no-op if there is none."""
        made = self.made.pop((owner, name), None)
        if made is not None:
            owner.drop(made)
            self._close(made)


class Provider(Registration):
    """Service or action that a node of this process offers."""

    def __init__(self, name: str, owner: NodeResources) -> None:
        self.name = name
        self.node = owner.name
        self.owner = owner
        self.closed = False

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            self.on_displaced = None
            self.owner.drop(self)
            self.withdraw()
            self.end_requests()

    @abstractmethod
    def withdraw(self) -> None:
        """Remove it from its table."""

    @abstractmethod
    def end_requests(self) -> None:
        """End pending calls or goals: this provider no longer answers them."""


P = TypeVar("P", bound=Provider)


class RemoteProviders(Protocol):
    """Services or actions of other processes."""

    def names(self) -> set[str]:
        """Return the names of all of them."""

    def by_node(self) -> Iterator[tuple[str, str]]:
        """Yield each node of another process with each of its services or actions."""


class ProviderTable(Generic[P]):
    """Current provider of each name: the newest, and after it closes, the one that it has replaced.

    Attributes:
        current: provider that answers, by name.
        changes: counter of changes of `current`.
        remote: providers of other processes; None in a graph of one process.
    """

    remote: RemoteProviders | None = None

    def __init__(self, changes: Changes) -> None:
        self.changes = changes
        self.current: dict[str, P] = {}
        #: Replaced providers of each name, the oldest first.
        self._replaced: dict[str, list[P]] = {}

    def __iter__(self) -> Iterator[P]:
        return iter(tuple(self.current.values()))

    def names(self) -> list[str]:
        return sorted(self.current.keys() | (self.remote.names() if self.remote is not None else set()))

    def by_node(self) -> Iterator[tuple[str, str]]:
        for provider in self:
            yield provider.node, provider.name
        if self.remote is not None:
            yield from self.remote.by_node()

    def displace(self, name: str, reason: str) -> None:
        """End the providers of nodes for clients: a program of the robot offers the name."""
        for provider in (*self._replaced.get(name, ()), self.current.get(name)):
            if provider is not None and provider.owner.for_clients:
                displace(provider, reason)

    def put(self, provider: P) -> P | None:
        """Make a provider the current one; return the one that it replaces."""
        provider.owner.add(provider, provider.close)
        old = self.current.get(provider.name)
        self.current[provider.name] = provider
        self.changes.note()
        if old is not None:
            self._replaced.setdefault(provider.name, []).append(old)
        return old

    def remove(self, provider: P) -> P | None:
        """Remove a provider; return the one that becomes current again."""
        name = provider.name
        self.changes.note()
        replaced = self._replaced.get(name, [])
        restored = None
        if self.current.get(name) is not provider:
            if provider in replaced:
                replaced.remove(provider)
        elif replaced:
            restored = self.current[name] = replaced.pop()
        else:
            del self.current[name]
        if not replaced:
            self._replaced.pop(name, None)
        return restored
