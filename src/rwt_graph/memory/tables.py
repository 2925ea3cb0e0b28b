"""Common parts of the tables: changes and cached listings, resources of nodes, and providers by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from rwt_graph.api import Registration

T = TypeVar("T")
P = TypeVar("P", bound=Registration)


class Changes:
    """Counter of changes to the listings of a graph.

    Attributes:
        count: number of changes so far.
    """

    __slots__ = ("count",)

    def __init__(self) -> None:
        self.count = 0

    def note(self) -> None:
        """Count a change."""
        self.count += 1


class CachedListing(Generic[T]):
    """Listing that is rebuilt on the first request after a change.

    Args:
        changes: counter of changes.
        make: builds the listing.
    """

    __slots__ = ("_at", "_changes", "_listing", "_make")

    def __init__(self, changes: Changes, make: Callable[[], T]) -> None:
        self._changes = changes
        self._make = make
        self._at = -1
        self._listing: T

    def __call__(self) -> T:
        count = self._changes.count
        if self._at != count:
            self._listing = self._make()
            self._at = count
        return self._listing


class NodeResources:
    """Resources of one node, each with the function that releases it.

    Attributes:
        name: absolute name of the node.
        private: True if the node and its endpoints are hidden from other processes.
    """

    def __init__(self, name: str, *, private: bool = False) -> None:
        self.name = name
        self.private = private
        self._release: dict[object, Callable[[], None]] = {}

    def __len__(self) -> int:
        return len(self._release)

    def add(self, resource: object, release: Callable[[], None]) -> None:
        """Add a resource; `release` must end in a :meth:`drop`."""
        self._release[resource] = release

    def drop(self, resource: object) -> None:
        """Remove a released resource."""
        self._release.pop(resource, None)

    def release_all(self) -> None:
        """Release every resource, the newest first."""
        while self._release:
            _, release = self._release.popitem()
            release()


class ProviderTable(Generic[P]):
    """Current provider of each name, and those that it has displaced.

    Attributes:
        current: provider that answers, by name.

    Args:
        changes: counter of changes of `current`.
    """

    def __init__(self, changes: Changes) -> None:
        self._changes = changes
        self.current: dict[str, P] = {}
        self._displaced: dict[str, list[P]] = {}

    def __iter__(self) -> Iterator[P]:
        return iter(tuple(self.current.values()))

    def put(self, provider: P) -> P | None:
        """Make a provider the current one; return the one that it displaces."""
        old = self.current.get(provider.name)
        self.current[provider.name] = provider
        self._changes.note()
        if old is not None:
            self._displaced.setdefault(provider.name, []).append(old)
        return old

    def remove(self, provider: P) -> P | None:
        """Remove a provider; return the one that becomes current again."""
        name = provider.name
        self._changes.note()
        displaced = self._displaced.get(name, [])
        restored = None
        if self.current.get(name) is not provider:
            if provider in displaced:
                displaced.remove(provider)
        elif displaced:
            restored = self.current[name] = displaced.pop()
        else:
            del self.current[name]
        if not displaced:
            self._displaced.pop(name, None)
        return restored
