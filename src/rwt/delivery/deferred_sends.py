"""Frames that take long to make: they are made in steps, and sent in the order in which they were asked
for."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt_graph.clock import Clock

logger = logging.getLogger("rwt.delivery")

SHARE: Final = 0.0015
"""Seconds of one turn of the event loop in which frames of one topic are made; the rest waits its turn."""


class DeferredSends:
    """What is to be sent of one topic, one after the other, each after the steps that prepare it.

    They are taken a share in each turn of the event loop. Whoever causes them may take them, too, by
    :meth:`steps`, so that they are its work and hold it up.
    """

    __slots__ = ("_added", "_clock", "_goes_on", "_is_stepping", "_sent", "_waiting")

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: deque[tuple[Iterator[None], Callable[[], None]]] = deque()
        self._added = 0
        self._sent = 0
        self._goes_on = False
        self._is_stepping = False

    @property
    def is_busy(self) -> bool:
        """Whether something waits to be sent."""
        return bool(self._waiting)

    def add(self, steps: Iterator[None], send: Callable[[], None]) -> None:
        """Call `send` after all that waits already, and after `steps`: before this returns, if that is
        quick."""
        self._waiting.append((steps, send))
        self._added += 1
        if not self._goes_on and not self._is_stepping:
            self._go_on()

    def steps(self) -> Iterator[None]:
        """Take the steps of all that waits now, and send it."""
        last = self._added
        while self._sent < last and self._waiting:
            self._step()
            yield

    def finish_first(self) -> None:
        """Send at once what would be sent next."""
        sent = self._sent
        while self._sent == sent and self._waiting:
            self._step()

    def clear(self) -> None:
        """Send nothing of what waits."""
        self._waiting.clear()
        self._sent = self._added

    def _step(self) -> None:
        steps, send = self._waiting[0]
        self._is_stepping = True
        try:
            for _ in steps:
                return
            self._waiting.popleft()
            self._sent += 1
            send()
        except Exception:
            logger.exception("a sample could not be sent")
            if self._waiting and self._waiting[0][0] is steps:
                self._waiting.popleft()
                self._sent += 1
        finally:
            self._is_stepping = False

    def _go_on(self) -> None:
        self._goes_on = False
        until = self._clock.monotonic() + SHARE
        while self._waiting:
            self._step()
            if self._waiting and self._clock.monotonic() > until:
                self._goes_on = True
                self._clock.call_later(0.0, self._go_on)
                return
