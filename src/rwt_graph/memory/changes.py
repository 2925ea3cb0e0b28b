"""What a graph lists is made once for each change, since clients may ask for it without end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Changes:
    """Counts the changes of what a graph lists.

    Attributes:
        count: so far.
    """

    __slots__ = ("count",)

    def __init__(self) -> None:
        self.count = 0

    def note(self) -> None:
        """Something has changed."""
        self.count += 1


class Kept(Generic[T]):
    """A listing, made when it is asked for after a change.

    Args:
        changes: of what is listed.
        make: makes the listing.
    """

    __slots__ = ("_at", "_changes", "_listing", "_make")

    def __init__(self, changes: Changes, make: Callable[[], T]) -> None:
        self._changes = changes
        self._make = make
        self._at = -1
        self._listing: T

    def __call__(self) -> T:
        """The listing as it is now."""
        count = self._changes.count
        if self._at != count:
            self._listing = self._make()
            self._at = count
        return self._listing
