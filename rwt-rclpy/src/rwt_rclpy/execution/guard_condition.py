"""`rclpy.guard_condition`: callbacks triggered by any thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rwt_rclpy.destroyable import Destroyable, Owner
from rwt_rclpy.execution.entity import Entity

if TYPE_CHECKING:
    from rwt_rclpy.execution.callback_groups import CallbackGroup
    from rwt_rclpy.execution.context import Context


class GuardCondition(Entity, Owner):
    """Guard condition, whose callback runs in the executor after :meth:`trigger`."""

    def __init__(
        self,
        callback: Callable[[], object] | None,
        callback_group: CallbackGroup | None,
        context: Context | None = None,
    ) -> None:
        super().__init__(callback_group)
        self.callback = callback
        self._handle = Destroyable()
        self._triggered = False

    def trigger(self) -> None:
        """Schedule the callback. Raises :exc:`InvalidHandle` after :meth:`destroy`."""
        self._handle.check()
        self._triggered = True
        self._rwt_wake()

    def _rwt_has_work(self) -> bool:
        """True if the condition was triggered."""
        return self._triggered and bool(self._handle)

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the callback."""
        self._triggered = False
        return self.callback
