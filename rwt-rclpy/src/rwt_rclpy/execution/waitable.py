"""`rclpy.waitable`: entities that programs compose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partialmethod
from typing import Any

from rwt_rclpy.execution.entity import Entity


@dataclass
class NumberOfEntities:
    """Number of entities of each kind that a waitable waits for."""

    num_subscriptions: int = 0
    num_guard_conditions: int = 0
    num_timers: int = 0
    num_clients: int = 0
    num_services: int = 0
    num_events: int = 0

    def __add__(self, other: NumberOfEntities) -> NumberOfEntities:
        return NumberOfEntities(*(mine + its for mine, its in zip(self._all(), other._all(), strict=True)))

    def __iadd__(self, other: NumberOfEntities) -> NumberOfEntities:
        for name in self.__dataclass_fields__:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        return self

    def _all(self) -> tuple[int, ...]:
        return tuple(getattr(self, name) for name in self.__dataclass_fields__)

    def __repr__(self) -> str:
        return f"<NumberOfEntities{self._all()}>"


class Waitable:
    """Entity of a program that an executor checks and executes."""

    def __init__(self, callback_group: Any) -> None:
        self.callback_group = callback_group
        self._futures: list[Any] = []
        self._executor_event = False

    def __enter__(self) -> None:
        """Begin to use it; may raise InvalidHandle."""

    def __exit__(self, *exc: object) -> None:
        """End its use."""

    def add_future(self, future: Any) -> None:
        """Let the executor run the future's callbacks."""
        self._futures.append(future)

    def remove_future(self, future: Any) -> None:
        """Undo :meth:`add_future`."""
        self._futures.remove(future)

    def is_ready(self, wait_set: WaitSet) -> bool:
        """True if one of the waitable's entities is ready."""
        raise NotImplementedError("Must be implemented by subclass")

    def take_data(self) -> Any:
        """Return the data to execute with."""
        raise NotImplementedError("Must be implemented by subclass")

    async def execute(self, taken_data: Any) -> None:
        """Execute the waitable."""
        raise NotImplementedError("Must be implemented by subclass")

    def get_num_entities(self) -> NumberOfEntities:
        """Return the number of entities that the waitable adds to a wait set."""
        raise NotImplementedError("Must be implemented by subclass")

    def add_to_wait_set(self, wait_set: WaitSet) -> None:
        """Add its entities to a wait set."""
        raise NotImplementedError("Must be implemented by subclass")


@dataclass
class WaitSet:
    """Wait set: entities that waitables wait for, by the number returned on adding."""

    entities: dict[str, list[Entity]] = field(default_factory=dict)

    def _add(self, kind: str, entity: Entity) -> int:
        known = self.entities.setdefault(kind, [])
        known.append(entity)
        return len(known) - 1

    add_subscription = partialmethod(_add, "subscription")
    add_guard_condition = partialmethod(_add, "guard_condition")
    add_timer = partialmethod(_add, "timer")
    add_client = partialmethod(_add, "client")
    add_service = partialmethod(_add, "service")

    def is_ready(self, kind: str, index: int) -> bool:
        """True if an entity has work."""
        return self.entities[kind][index]._rwt_has_work()


class WaitableEntity(Entity):
    """Adapter of a program's waitable for executors."""

    def __init__(self, waitable: Waitable) -> None:
        super().__init__(waitable.callback_group)
        self.waitable = waitable

    def _rwt_has_work(self) -> bool:
        """True if the waitable is ready with a wait set of its entities."""
        wait_set = WaitSet()
        with self.waitable:
            self.waitable.add_to_wait_set(wait_set)
            return self.waitable.is_ready(wait_set)

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return a function that executes the data that the waitable has taken."""
        data = self.waitable.take_data()
        return lambda: self.waitable.execute(data)
