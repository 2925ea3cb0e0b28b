"""Handles, in place of rclpy's pointers to C objects."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Self

from rwt_rclpy.exceptions import InvalidHandle
from rwt_rclpy.release import FROM_KILTED


class Destroyable:
    """Handle of an entity that is destroyed once it is unused; ``with handle:`` uses it.

    Args:
        on_destroy: called once, when it is destroyed.
    """

    def __init__(self, on_destroy: Callable[[], None] | None = None) -> None:
        self._on_destroy = on_destroy
        self._users = 0
        self._wanted_gone = False
        self._gone = False
        self._lock = threading.Lock()

    @property
    def pointer(self) -> int:
        """Number, unique among existing handles."""
        return id(self)

    def __bool__(self) -> bool:
        return not self._wanted_gone

    def __enter__(self) -> Self:
        with self._lock:
            self.check()
            self._users += 1
        return self

    def __exit__(self, *exc: object) -> None:
        with self._lock:
            self._users -= 1
        self._settle()

    def check(self) -> None:
        """Raise :exc:`InvalidHandle` if it was destroyed."""
        if self._wanted_gone:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")

    def destroy_when_not_in_use(self) -> None:
        """Destroy it now, or after its last use."""
        self._wanted_gone = True
        self._settle()

    def _settle(self) -> None:
        with self._lock:
            if not self._wanted_gone or self._users or self._gone:
                return
            self._gone = True
            call, self._on_destroy = self._on_destroy, None
        if call is not None:
            call()


class Owner:
    """Object that is destroyed with its handle."""

    _handle: Destroyable

    @property
    def handle(self) -> Destroyable:
        """Handle that destroys the object."""
        return self._handle

    def destroy(self) -> None:
        """Destroy it once it is unused."""
        self._handle.destroy_when_not_in_use()


class Closable(Owner):
    """Object that a ``with`` statement destroys, from ROS 2 Kilted on."""

    if FROM_KILTED:

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *exc: object) -> None:
            self.destroy()
