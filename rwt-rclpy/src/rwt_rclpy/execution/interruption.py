"""Deferral of Ctrl-C during work of an executor with locks and threads, which must not be interrupted.

Python runs a handler of a signal between any two steps of the main thread, also between those that take a
lock and note that it is taken, or that start a thread of a pool and note that it is there. KeyboardInterrupt
raised there leaves a lock that nobody releases or a thread that nobody ends: the program hangs at its end.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final


class Uninterrupted:
    """A part of the main thread that a handler does not interrupt; what the handler does is done at its end.

    Parts may be nested; the end of the outermost one counts. In other threads, where no handler runs, it does
    nothing. What runs in it has to come to its end: by what else the handler does, if it waits.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._put_off: Callable[[], object] | None = None

    def __enter__(self) -> None:
        if threading.get_ident() == threading.main_thread().ident:
            self._depth += 1

    def __exit__(self, *exc: object) -> None:
        if threading.get_ident() != threading.main_thread().ident:
            return
        self._depth -= 1
        if not self._depth and self._put_off is not None:
            call, self._put_off = self._put_off, None
            call()

    def interrupt(self, call: Callable[[], object]) -> None:
        """Call at the end of the part that runs, or now if none does.

        Who interrupts a second time does not want to wait any more: that is now, too.
        """
        if self._depth and self._put_off is None:
            self._put_off = call
            return
        self._put_off = None
        call()


#: The parts of this process.
UNINTERRUPTED: Final = Uninterrupted()
