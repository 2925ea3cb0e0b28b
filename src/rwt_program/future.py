"""A value that comes once, from a callback to whatever awaits it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from enum import Enum
from typing import Final, Generic, TypeAlias, TypeVar

import anyio

from rwt_program.errors import CallTimeout

T = TypeVar("T")


class _Usual(Enum):
    TIMEOUT = "the usual"


#: The timeout of what is given none: that of the node or the connection.
USUAL: Final = _Usual.TIMEOUT

#: Seconds; None waits as long as it takes.
Timeout: TypeAlias = float | _Usual | None

#: Bounds what is awaited in a block to so many seconds of some clock; None does not. The block is left early.
Within: TypeAlias = Callable[[float | None], AbstractContextManager[object]]


class Future(Generic[T]):
    """Set on the event loop's thread, awaited by any number of tasks. The first value or error stays."""

    __slots__ = ("_event", "_values")

    def __init__(self) -> None:
        self._values: list[T | Exception] = []
        # Made by whatever waits: events can be made in tasks only, and mostly nothing needs to wait.
        self._event: anyio.Event | None = None

    @property
    def done(self) -> bool:
        """Whether the value or the error has come."""
        return bool(self._values)

    @property
    def awaited(self) -> bool:
        """Whether something waits for it, or has."""
        return self._event is not None

    def set(self, value: T | Exception) -> None:
        """Give the value, or the error to raise; later ones are ignored."""
        if not self._values:
            self._values.append(value)
            if self._event is not None:
                self._event.set()

    async def wait(self) -> T:
        """The value, at once if it is there already; raises the error that was set."""
        if not self._values:
            if self._event is None:
                self._event = anyio.Event()
            await self._event.wait()
        value = self._values[0]
        if isinstance(value, Exception):
            raise value
        return value

    async def get(self, timeout: float | None, late: str, within: Within = anyio.move_on_after) -> T:
        """Wait for the value.

        Args:
            timeout: seconds; None waits as long as it takes.
            late: what to say when it does not come in time.
            within: the clock that bounds it.

        Raises:
            CallTimeout: it did not come in time.
            Exception: the error that was set.
        """
        with within(timeout):
            return await self.wait()
        raise CallTimeout(f"{late} within {timeout:g} s")
