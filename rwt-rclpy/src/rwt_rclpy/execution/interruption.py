"""Deferral of Ctrl-C during work of an executor with locks and threads, which must not be interrupted.

Python runs signal handlers between any two steps of the main thread, also between those that take a
lock and record it, or that start a thread of a pool and record it. KeyboardInterrupt
raised there leaves a locked lock or a running thread: the program hangs at its end.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final


class Uninterrupted:
    """Section of the main thread that signal handlers do not interrupt; their actions follow at its end.

    Sections may be nested; the end of the outermost one counts. In other threads, where no handlers run, it
    has no effect. Code in it must end: waits must be ended by other effects of the handler.
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
        """Call a function at the end of the current section, or now if there is none.

        A second interrupt calls it now, too.
        """
        if self._depth and self._put_off is None:
            self._put_off = call
            return
        self._put_off = None
        call()


#: Sections of this process.
UNINTERRUPTED: Final = Uninterrupted()
