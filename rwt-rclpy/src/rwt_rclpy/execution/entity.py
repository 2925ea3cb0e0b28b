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
    """Something that has work for an executor now and then.

    Attributes:
        callback_group: which callbacks may run beside its own.
        _rwt_wake: makes the executor look again; set by the node that it belongs to.
    """

    def __init__(self, callback_group: CallbackGroup | None) -> None:
        self.callback_group: Any = callback_group
        self._rwt_wake: Callable[[], None] = _nothing
        # rclpy's name: whether an executor has it in hand.
        self._executor_event = False

    @abstractmethod
    def _rwt_has_work(self) -> bool:
        """True if a callback is ready to run."""

    @abstractmethod
    def _rwt_take(self) -> Callable[[], object] | None:
        """The callback to run now, which may return a coroutine; None when there is none after all."""

    def _rwt_due_in_ns(self) -> int | None:
        """Nanoseconds until it has work by itself; None when it waits for something else than time."""
        return None
