"""Deferred sending of samples that take long to encode, in order."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from rwt_transports.turns import TOPIC_SECONDS

if TYPE_CHECKING:
    from rwt_transports.turns import Turns

logger = logging.getLogger("rwt.delivery")


class DeferredSends:
    """Samples of one topic to send, each after the steps that prepare it, in the order in which they were
    added.

    Steps are taken in turns of the event loop, `TOPIC_SECONDS` in each. A program that causes them can take
    them with :meth:`steps` instead, so that they are its work and delay only it.

    Private attributes: ``_is_scheduled`` is True while a turn is requested; ``_is_stepping`` is True inside a
    step, which may add samples.

    Attributes:
        waiting: steps and send function of each deferred sample; read-only.
    """

    __slots__ = ("_added", "_is_scheduled", "_is_stepping", "_sent", "_turns", "waiting")

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self.waiting: deque[tuple[Iterator[None], Callable[[], None]]] = deque()
        self._added = self._sent = 0
        self._is_scheduled = self._is_stepping = False

    def add(self, steps: Iterator[None], send: Callable[[], None]) -> None:
        """Call `send` after `steps` and all queued samples: before this returns, if that is
        fast."""
        self.waiting.append((steps, send))
        self._added += 1
        if not self._is_scheduled and not self._is_stepping:
            self._go_on()

    def steps(self) -> Iterator[None]:
        """Run the steps of all samples queued now, and send them."""
        last = self._added
        while self._sent < last and self.waiting:
            self._step()
            yield

    def finish_first(self) -> None:
        """Prepare and send the oldest sample now."""
        sent = self._sent
        while self._sent == sent and self.waiting:
            self._step()

    def clear(self) -> None:
        """Drop all queued samples."""
        self.waiting.clear()
        self._sent = self._added

    def _step(self) -> object:
        """Take one step of the oldest sample, and send it after the last. Returns what is done with it."""
        steps, send = self.waiting[0]
        self._is_stepping = True
        try:
            for _ in steps:
                return None
            self.waiting.popleft()
            self._sent += 1
            send()
        except Exception:
            logger.exception("a sample could not be sent")
            if self.waiting and self.waiting[0][0] is steps:
                self.waiting.popleft()
                self._sent += 1
        finally:
            self._is_stepping = False
        return steps, send

    def _go_on(self) -> None:
        self._is_scheduled = False
        monotonic = self._turns.monotonic
        until = monotonic() + TOPIC_SECONDS
        while self.waiting:
            done = self._step()
            if done is not None and monotonic() > until:
                # Freeing half a million numbers takes milliseconds: it has a turn of its own.
                self._turns.wait(partial(_free, done))
            if self.waiting and monotonic() > until:
                self._is_scheduled = True
                self._turns.wait(self._go_on)
                return


def _free(done: object) -> None:
    """No-op: the caller drops the last reference."""
