"""Who provides what: the newest provider of a name answers, and an older one again when it has gone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, Protocol, TypeVar

from rwt_graph.memory.changes import Changes


class Provider(Protocol):
    """A service or an action that a node offers."""

    name: str


P = TypeVar("P", bound=Provider)


class ProviderTable(Generic[P]):
    """The provider of each name, and those that it has displaced.

    Attributes:
        current: the provider that answers, by name.

    Args:
        changes: hears of those of `current`.
    """

    def __init__(self, changes: Changes) -> None:
        self._changes = changes
        self.current: dict[str, P] = {}
        self._displaced: dict[str, list[P]] = {}

    def __iter__(self) -> Iterator[P]:
        return iter(tuple(self.current.values()))

    def put(self, provider: P) -> P | None:
        """Let a provider answer from now on; gives the one that it displaces."""
        old = self.current.get(provider.name)
        self.current[provider.name] = provider
        self._changes.note()
        if old is not None:
            self._displaced.setdefault(provider.name, []).append(old)
        return old

    def remove(self, provider: P) -> P | None:
        """Forget a provider; gives the one that answers again in its place."""
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
