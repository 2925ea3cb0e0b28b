"""Blocking waits of a thread, which end with the context."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rwt_rclpy.execution.interruption import UNINTERRUPTED

if TYPE_CHECKING:
    from rwt_rclpy.execution.context import Context


class Wait:
    """A wait of one thread; who changes what it waits for calls :meth:`wake`.

    Ctrl-C raises KeyboardInterrupt in the main thread as soon as the wait holds no lock: the end of the
    context wakes it. After that end, which SIGTERM brings too, no executor brings an answer any more.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._keeper = context._rwt_link.timekeeper
        self._condition = self._keeper.condition()
        context._rwt_wake_on_end(self)

    def wake(self) -> None:
        """Look again."""
        with self._condition:
            self._condition.notify_all()

    def until(self, ready: Callable[[], bool], timeout_sec: float | None = None) -> bool:
        """Wait; says whether it is so, which it is not when the time is over or the context has ended.

        Args:
            ready: looks; it is called with the lock held, and may not wait itself.
            timeout_sec: None or a negative number for as long as it takes.
        """
        forever = timeout_sec is None or timeout_sec < 0
        deadline = None if forever else self._keeper.steady_ns() + int((timeout_sec or 0) * 1e9)
        with UNINTERRUPTED, self._condition:
            while not ready():
                if not self._context.ok() or (deadline is not None and self._keeper.steady_ns() >= deadline):
                    return False
                self._keeper.wait(self._condition, deadline)
        return True
