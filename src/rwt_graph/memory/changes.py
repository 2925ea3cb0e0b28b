"""Cached listings of a graph, rebuilt once per change because clients may request them often."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


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
