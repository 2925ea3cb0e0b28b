"""Grip of a control of the Drive panel by a person."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

import anyio

from tests.browser.driver import Page
from tests.waiting import until


class Grip:
    """A control of the Drive panel, held by a person who does not let go."""

    def __init__(self, page: Page, control: str) -> None:
        self._page = page
        self._control = control

    async def hold(self) -> None:
        """Take the control, and drive forward."""
        if self._control == "key":
            await self._page.evaluate("document.querySelector('.drive-left').focus()")
            await self._page.keyboard("down", "ArrowUp")
        elif self._control == "stick":
            # Notices of a lost connection move it below the bar of the page.
            await self._page.evaluate("document.querySelector('.stick').scrollIntoView({block: 'center'})")
            box = "document.querySelector('.stick').getBoundingClientRect()"
            x, y, width = await self._page.evaluate(f"(b => [b.left, b.top, b.width])({box})")
            await self._page.mouse("move", x + width / 2, y + width / 2)
            await self._page.mouse("down")
            await self._page.mouse("move", x + width / 2, y + 2)
        else:
            await self._page.evaluate("(pad.axes[1] = -1, pad.buttons[4].pressed = true)")

    async def keep(self) -> None:
        """Do what a held control does by itself: a key repeats, a hand trembles."""
        if self._control == "key":
            await self._page.keyboard("down", "ArrowUp")
        elif self._control == "stick":
            box = "document.querySelector('.stick').getBoundingClientRect()"
            x, y, width = await self._page.evaluate(f"(b => [b.left, b.top, b.width])({box})")
            await self._page.mouse("move", x + width / 2 + 1, y + 3)
            await self._page.mouse("move", x + width / 2, y + 2)

    async def release(self) -> None:
        """Let go."""
        if self._control == "key":
            await self._page.keyboard("up", "ArrowUp")
        elif self._control == "stick":
            await self._page.mouse("up")
        else:
            await self._page.evaluate("(pad.axes[1] = 0, pad.buttons[4].pressed = false, pad.reads = 0)")
            await self._page.wait("pad.reads > 0")  # The page sees it when it looks again.

    async def drive_until(self, moves: Callable[[], bool]) -> None:
        """Hold the control until the robot moves; raises TimeoutError."""
        await _repeated(self.hold, self.release, moves)


async def hold_until(page: Page, key: str, moves: Callable[[], bool]) -> None:
    """Hold a key until the robot moves; raises TimeoutError."""
    await _repeated(partial(page.keyboard, "down", key), partial(page.keyboard, "up", key), moves)


async def _repeated(
    hold: Callable[[], Awaitable[None]], release: Callable[[], Awaitable[None]], moves: Callable[[], bool]
) -> None:
    """Hold a control until the robot moves, with a new grip every two seconds.

    A page that is too busy for half a second drops the grip.

    Raises:
        TimeoutError: twenty grips did not move the robot.
    """
    for _ in range(20):
        await hold()
        with anyio.move_on_after(2):
            await until(moves)
            return
        await release()
    raise TimeoutError("the robot does not move although its control was held twenty times")
