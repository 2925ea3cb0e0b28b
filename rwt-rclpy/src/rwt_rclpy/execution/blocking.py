"""Blocking waits of a thread, which end with the context."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rwt_rclpy.clocks.timekeeper import Waker
from rwt_rclpy.execution.interruption import UNINTERRUPTED

if TYPE_CHECKING:
    from rwt_rclpy.execution.context import Context


class Wait(Waker):
    """Wait of one thread; a change of its condition must be followed by :meth:`wake`.

    Ctrl-C raises KeyboardInterrupt in the main thread as soon as the wait holds no lock, because the end of
    the context wakes it. After that end, also by SIGTERM, no executor delivers responses.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._keeper = context._rwt_link.timekeeper
        self._condition = self._keeper.condition()
        context._rwt_wake_on_end(self)

    def wake(self) -> None:
        """Check the condition again."""
        with self._condition:
            self._condition.notify_all()

    def until(self, ready: Callable[[], bool], timeout_sec: float | None = None) -> bool:
        """Wait for the condition. Returns False after the timeout or the end of the context.

        Args:
            ready: condition; called with the lock held, and must not wait itself.
            timeout_sec: None or a negative number for no timeout.
        """
        deadline = self._keeper.deadline(timeout_sec)
        with UNINTERRUPTED, self._condition:
            self._keeper.wait_for(self._condition, lambda: ready() or not self._context.ok(), deadline)
            return ready()
