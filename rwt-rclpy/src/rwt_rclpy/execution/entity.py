"""Base class of everything with callbacks that an executor runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rwt_rclpy.execution.callback_groups import CallbackGroup


def _nothing() -> None:
    pass


class Entity(ABC):
    """Entity with callbacks for an executor.

    Attributes:
        callback_group: group of its callbacks.
        _rwt_    wake: wakes the executor; set by the entity's node.
    """

    def __init__(self, callback_group: CallbackGroup | None) -> None:
        self.callback_group: Any = callback_group
        self._rwt_wake: Callable[[], None] = _nothing
        # rclpy's name: True while an executor handles it.
        self._executor_event = False

    @abstractmethod
    def _rwt_has_work(self) -> bool:
        """True if a callback is ready to run."""

    @abstractmethod
    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the callback to run now, which may return a coroutine; None if there is none."""

    def _rwt_due_in_ns(self) -> int | None:
        """Return the nanoseconds until it is ready; None if that does not depend on time."""
        return None
