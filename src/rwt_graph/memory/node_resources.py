"""What a node has made and must take with it when it leaves."""

from __future__ import annotations

from collections.abc import Callable


class NodeResources:
    """One node's things, each with how to let go of it.

    Attributes:
        name: absolute name of the node.
        private: whether the node and what it makes stay unknown to other processes.
    """

    def __init__(self, name: str, *, private: bool = False) -> None:
        self.name = name
        self.private = private
        self._release: dict[object, Callable[[], None]] = {}

    def __len__(self) -> int:
        return len(self._release)

    def add(self, thing: object, release: Callable[[], None]) -> None:
        """Remember a thing; `release` must end in a :meth:`drop`."""
        self._release[thing] = release

    def drop(self, thing: object) -> None:
        """Forget a thing that is gone."""
        self._release.pop(thing, None)

    def release_all(self) -> None:
        """Let go of everything, the newest first."""
        while self._release:
            _, release = self._release.popitem()
            release()


__all__ = ["NodeResources"]
