"""Providers by name: the newest answers, and after it closes, the previous one again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

from rwt_graph.api import Registration
from rwt_graph.memory.changes import Changes

P = TypeVar("P", bound=Registration)


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
