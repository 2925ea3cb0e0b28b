"""One outcome that somebody waits for."""

from __future__ import annotations

from typing import Generic, TypeVar

import anyio

from rwt_program.errors import CallTimeout

T = TypeVar("T")


class Outcome(Generic[T]):
    """A value or an error that comes once; whatever comes later is ignored."""

    __slots__ = ("_error", "_event", "_value")

    def __init__(self) -> None:
        self._event = anyio.Event()
        self._value: T | None = None
        self._error: Exception | None = None

    @property
    def done(self) -> bool:
        """Whether it has come."""
        return self._event.is_set()

    def resolve(self, value: T) -> None:
        """It is this value."""
        if not self.done:
            self._value = value
            self._event.set()

    def fail(self, error: Exception) -> None:
        """It is this error."""
        if not self.done:
            self._error = error
            self._event.set()

    async def get(self, timeout: float | None, late: str) -> T:
        """Wait for it.

        Args:
            timeout: seconds; None waits for ever.
            late: what to say when it does not come in time.

        Raises:
            CallTimeout: it did not come in time.
            Exception: the error that it is.
        """
        with anyio.move_on_after(timeout):
            await self._event.wait()
        if not self.done:
            raise CallTimeout(f"{late} within {timeout:g} s")
        if self._error is not None:
            raise self._error
        value: T = self._value  # type: ignore[assignment]  # without an error there is a value, perhaps None
        return value
