"""Clock of the player; tests use a virtual one."""

from __future__ import annotations

import asyncio
from typing import Protocol


class Pace(Protocol):
    """A clock that can be waited on."""

    def now(self) -> float:
        """Seconds since any fixed moment."""

    async def sleep(self, seconds: float) -> None:
        """Let time pass."""

    async def wait(self, event: asyncio.Event, seconds: float) -> bool:
        """Wait for an event for at most so long; whether it came."""


class RealPace:
    """The time of this machine."""

    def now(self) -> float:
        """Seconds of the event loop's clock."""
        return asyncio.get_running_loop().time()

    async def sleep(self, seconds: float) -> None:
        """Let time pass."""
        await asyncio.sleep(seconds)

    async def wait(self, event: asyncio.Event, seconds: float) -> bool:
        """Wait for an event for at most so long; whether it came."""
        try:
            async with asyncio.timeout(seconds):
                await event.wait()
        except TimeoutError:
            return False
        return True
