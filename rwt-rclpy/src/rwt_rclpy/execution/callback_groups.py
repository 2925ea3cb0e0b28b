"""`rclpy.callback_groups`: concurrency of callbacks."""

from __future__ import annotations

import threading
import weakref
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rwt_rclpy.execution.entity import Entity


class CallbackGroup(ABC):
    """Group of entities with a rule for concurrent callbacks."""

    def __init__(self) -> None:
        self.entities: set[weakref.ref[Entity]] = set()

    def add_entity(self, entity: Entity) -> None:
        """Add an entity; it is not kept alive."""
        self.entities.add(weakref.ref(entity))

    def has_entity(self, entity: Entity) -> bool:
        """True if an entity belongs to the group."""
        return weakref.ref(entity) in self.entities

    @abstractmethod
    def can_execute(self, entity: Entity) -> bool:
        """True if an entity's callback may run now."""

    @abstractmethod
    def beginning_execution(self, entity: Entity) -> bool:
        """Begin a callback. Returns False if it may not run now."""

    @abstractmethod
    def ending_execution(self, entity: Entity) -> None:
        """End a callback."""


class ReentrantCallbackGroup(CallbackGroup):
    """Group whose callbacks may run concurrently, also several times."""

    def can_execute(self, entity: Entity) -> bool:
        """Return True."""
        return True

    def beginning_execution(self, entity: Entity) -> bool:
        """Return True."""
        return True

    def ending_execution(self, entity: Entity) -> None:
        """No-op."""


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """Group in which one callback runs at a time."""

    def __init__(self) -> None:
        super().__init__()
        self._active: weakref.ref[Entity] | None = None
        self._lock = threading.Lock()

    def can_execute(self, entity: Entity) -> bool:
        """True if no callback of the group runs."""
        if weakref.ref(entity) not in self.entities:
            raise AssertionError("the entity is not of this callback group")
        return self._active is None

    def beginning_execution(self, entity: Entity) -> bool:
        """Begin a callback if none runs. Returns False otherwise."""
        with self._lock:
            if weakref.ref(entity) not in self.entities:
                raise AssertionError("the entity is not of this callback group")
            if self._active is None:
                self._active = weakref.ref(entity)
                return True
            return False

    def ending_execution(self, entity: Entity) -> None:
        """End the running callback."""
        with self._lock:
            if self._active != weakref.ref(entity):
                raise AssertionError("another callback is the one that runs")
            self._active = None
