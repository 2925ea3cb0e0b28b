"""A value that comes once, from a callback to whoever awaits it."""

from __future__ import annotations

from typing import Generic, TypeVar

import anyio

T = TypeVar("T")


class Outcome(Generic[T]):
    """Set from a callback of the graph's thread, awaited by any number of tasks. The first value stays."""

    __slots__ = ("_event", "_values")

    def __init__(self) -> None:
        self._values: list[T] = []
        # Made by whoever waits: events can be made in tasks only, and mostly nobody needs to wait.
        self._event: anyio.Event | None = None

    @property
    def known(self) -> bool:
        """Whether the value has come."""
        return bool(self._values)

    def set(self, value: T) -> None:
        """Give the value; later ones are ignored."""
        if not self._values:
            self._values.append(value)
            if self._event is not None:
                self._event.set()

    async def wait(self) -> T:
        """The value, at once if it is there already."""
        if not self._values:
            if self._event is None:
                self._event = anyio.Event()
            await self._event.wait()
        return self._values[0]


__all__ = ["Outcome"]
