"""Clock of the player; tests use a virtual one."""

from __future__ import annotations

import asyncio
from typing import Protocol


class Pace(Protocol):
    """Clock with waits."""

    def now(self) -> float:
        """Return the seconds since a fixed time."""

    async def sleep(self, seconds: float) -> None:
        """Wait for some seconds."""

    async def wait(self, event: asyncio.Event, seconds: float) -> bool:
        """Wait for an event. Returns False after the timeout."""


class RealPace:
    """Clock of this machine."""

    def now(self) -> float:
        """Return the seconds of the event loop's clock."""
        return asyncio.get_running_loop().time()

    async def sleep(self, seconds: float) -> None:
        """Wait for some seconds."""
        await asyncio.sleep(seconds)

    async def wait(self, event: asyncio.Event, seconds: float) -> bool:
        """Wait for an event. Returns False after the timeout."""
        try:
            async with asyncio.timeout(seconds):
                await event.wait()
        except TimeoutError:
            return False
        return True
