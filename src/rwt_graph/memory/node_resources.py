"""Publishers, subscriptions, services and calls of a node, which end when it leaves."""

from __future__ import annotations

from collections.abc import Callable


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
