"""Entities of launch descriptions, and the context in which they are visited.

An entity is visited once. It returns the entities to visit next, before its successors, and possibly a
future, for which the launch waits before it is idle.
"""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import Callable, Iterable, MutableMapping, Sequence
from typing import Any, TypeAlias, TypeVar

from rwt_participant.errors import RobotError

_Value = TypeVar("_Value")


class LaunchError(RobotError, RuntimeError):
    """A launch description is invalid; the text gives reason and alternative."""


class Substitution:
    """Text that is evaluated during the launch."""

    def describe(self) -> str:
        """Return a description for people."""
        return type(self).__name__

    def perform(self, context: LaunchContext) -> str:
        """Return the text. Raises SubstitutionFailure."""
        raise NotImplementedError


SomeSubstitutionsType: TypeAlias = str | os.PathLike[str] | Substitution | Iterable[Any]
#: Accepted values for texts in launch files.
SomeText: TypeAlias = SomeSubstitutionsType | int | float


def text(context: LaunchContext, value: SomeText) -> str:
    """Return the joined value of a string, a number, a substitution or a list of them.

    Raises:
        LaunchError: the value is of another type.
    """
    if isinstance(value, str):
        return value
    if isinstance(value, Substitution):
        return value.perform(context)
    if isinstance(value, (int, float, os.PathLike)):
        return str(value)
    if isinstance(value, Iterable):
        return "".join(text(context, each) for each in value)
    raise LaunchError(f"expected a text, a substitution or a list of them, got {value!r}")


def truth(context: LaunchContext, value: bool | SomeText) -> bool:
    """Return the value of a condition's expression: `true` or `1`, `false` or `0`, in any case.

    Raises:
        LaunchError: the value is something else.
    """
    said = (str(value) if isinstance(value, bool) else text(context, value)).strip().lower()
    if said in ("true", "1"):
        return True
    if said in ("false", "0"):
        return False
    raise LaunchError(f"a condition must be true, 1, false or 0, got {said!r}")


class Event:
    """Event for event handlers."""

    name = "launch.Event"


class ActionEvent(Event):
    """Event of an action."""

    def __init__(self, *, action: Action) -> None:
        self.action = action


class ExecutionComplete(ActionEvent):
    """Event: an action is done."""

    name = "launch.events.ExecutionComplete"


class Condition:
    """Condition by a function of the context."""

    def __init__(self, *, predicate: Callable[[LaunchContext], bool]) -> None:
        self._predicate = predicate

    def evaluate(self, context: LaunchContext) -> bool:
        """True if the condition holds."""
        return self._predicate(context)


class EventHandler:
    """Handler of matching events.

    Args:
        matcher: returns True for matching events.
        entities: entities to visit.
        handle_once: True to handle only the first event.
    """

    def __init__(
        self,
        *,
        matcher: Callable[[Event], bool],
        entities: SomeEntitiesType | None = None,
        handle_once: bool = False,
    ) -> None:
        self.matcher = matcher
        self.entities = entities_of(entities)
        self.handle_once = handle_once

    def matches(self, event: Event) -> bool:
        """True if the handler handles the event."""
        return self.matcher(event)

    def handle(self, event: Event, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Return the entities to visit; the event is in `context.locals` during their visit."""
        context.extend_locals({"event": event})
        if self.handle_once:
            context.unregister_event_handler(self)
        return self.entities


class Locals:
    """Values available while an event is handled, by attribute."""

    def __init__(self, values: dict[str, Any]) -> None:
        self.__dict__.update(values)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"there is no {name!r} here: only while an event is handled, or in a file")


class LaunchContext:
    """State of the visit of a description: configurations, environment, handlers and events.

    Attributes:
        argv: command line.
        noninteractive: True if Ctrl-C reaches this process alone, and not its children.
        launch_configurations: values of arguments and of actions, by name.
        is_shutdown: True while the launch ends.
    """

    def __init__(self, *, argv: Sequence[str] | None = None, noninteractive: bool = False) -> None:
        self.argv = list(argv or ())
        self.noninteractive = noninteractive
        self.launch_configurations: dict[str, Any] = {}
        self.is_shutdown = False
        self.handlers: deque[EventHandler] = deque()
        self.events: deque[Event] = deque()
        #: Number of requests by name, for the numbers of processes.
        self.process_count = 0
        self.news = asyncio.Event()
        self._locals: list[dict[str, Any]] = [{}]
        self._configurations: list[dict[str, Any]] = []
        self._environments: list[dict[str, str]] = []
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def environment(self) -> MutableMapping[str, str]:
        """Environment of started processes: that of this process."""
        return os.environ

    @property
    def asyncio_loop(self) -> asyncio.AbstractEventLoop:
        """Return the event loop of the launch. Raises LaunchError if it does not run."""
        if self._loop is None:
            raise LaunchError("the launch does not run")
        return self._loop

    def begin(self) -> None:
        """Use the running event loop."""
        self._loop, self.news = asyncio.get_running_loop(), asyncio.Event()
        self.is_shutdown = False

    @property
    def locals(self) -> Locals:
        """Values available while the current event is handled."""
        return Locals(self._locals[-1])

    def get_locals_as_dict(self) -> dict[str, Any]:
        """Return the same values by name."""
        return self._locals[-1]

    def extend_locals(self, values: dict[str, Any]) -> None:
        """Add values."""
        self._locals[-1].update(values)

    def push_locals(self) -> None:
        """Save the values for :meth:`pop_locals`."""
        self._locals.append(dict(self._locals[-1]))

    def pop_locals(self) -> None:
        """Restore the values saved by :meth:`push_locals`."""
        self._locals.pop()

    def push_configurations(self) -> None:
        """Save the configurations."""
        self._configurations.append(dict(self.launch_configurations))

    def pop_configurations(self) -> None:
        """Restore the saved configurations."""
        self.launch_configurations = _last(self._configurations, "launch configurations")

    def push_environment(self) -> None:
        """Save the environment."""
        self._environments.append(dict(os.environ))

    def pop_environment(self) -> None:
        """Restore the saved environment."""
        kept = _last(self._environments, "environment")
        os.environ.clear()
        os.environ.update(kept)

    def perform_substitution(self, value: SomeSubstitutionsType) -> str:
        """Return the value of a substitution."""
        return text(self, value)

    def register_event_handler(self, handler: EventHandler, append: bool = False) -> None:
        """Register an event handler before the existing ones, or after them with `append`."""
        if append:
            self.handlers.append(handler)
        else:
            self.handlers.appendleft(handler)

    def unregister_event_handler(self, handler: EventHandler) -> None:
        """Unregister an event handler. Raises ValueError if it was not registered."""
        self.handlers.remove(handler)

    def would_handle_event(self, event: Event) -> bool:
        """True if a handler handles the event."""
        return any(handler.matches(event) for handler in self.handlers)

    def emit_event_sync(self, event: Event) -> None:
        """Queue an event."""
        self.events.append(event)
        self.news.set()

    async def emit_event(self, event: Event) -> None:
        """Queue an event; :meth:`emit_event_sync` for coroutines."""
        self.emit_event_sync(event)


def _last(kept: list[_Value], what: str) -> _Value:
    if not kept:
        raise LaunchError(f"nothing was pushed of the {what}, and so there is nothing to pop")
    return kept.pop()


class LaunchDescriptionEntity:
    """Base class of the entities of a launch description.

    Attributes:
        declares: name of the argument that it declares, if any.
    """

    declares: str | None = None

    def visit(self, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Visit the entity; return the entities to visit next."""
        raise NotImplementedError

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """Return a future that is done with the entity; None if it is done at once."""
        return None

    def get_sub_entities(self) -> Iterable[LaunchDescriptionEntity]:
        """Return the contained entities, as far as known before the visit."""
        return ()


SomeEntitiesType: TypeAlias = LaunchDescriptionEntity | Iterable[LaunchDescriptionEntity]


def entities_of(some: object) -> list[LaunchDescriptionEntity]:
    """Return entities as a list: one, several or none.

    Raises:
        LaunchError: an item is not an entity.
    """
    given = [] if some is None else some if isinstance(some, Iterable) else [some]
    found: list[LaunchDescriptionEntity] = []
    for each in given:
        if not isinstance(each, LaunchDescriptionEntity):
            raise LaunchError(f"expected actions or launch descriptions, got {each!r}")
        found.append(each)
    return found


class Action(LaunchDescriptionEntity):
    """Action.

    Args:
        condition: condition of execution; always by default.
    """

    def __init__(self, *, condition: Condition | None = None) -> None:
        self.condition = condition

    def visit(self, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Execute the action if its condition holds, and report its end."""
        if self.condition is not None and not self.condition.evaluate(context):
            return None
        after = self.execute(context)
        event = ExecutionComplete(action=self)
        if context.would_handle_event(event):
            future = self.get_asyncio_future()
            if future is None:
                context.emit_event_sync(event)
            else:
                future.add_done_callback(lambda _: context.emit_event_sync(event))
        return after

    def execute(self, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Execute the action; return the entities to visit next."""
        return None


class LaunchDescription(LaunchDescriptionEntity):
    """Entities of a launch file, in order.

    Attributes:
        entities: contained entities.
    """

    def __init__(
        self, initial_entities: Iterable[LaunchDescriptionEntity] | None = None, **_: object
    ) -> None:
        self.entities = entities_of(initial_entities)

    def visit(self, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        """Return the entities of the description."""
        return self.entities

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        """Return the entities of the description."""
        return self.entities

    def add_action(self, action: LaunchDescriptionEntity) -> None:
        """Append an entity."""
        self.entities.extend(entities_of(action))

    add_entity = add_action

    def get_launch_arguments(self) -> list[Any]:
        """Return the declared arguments, as far as known before the visit."""
        found: dict[str, LaunchDescriptionEntity] = {}
        waiting: list[LaunchDescriptionEntity] = [self]
        while waiting:
            each = waiting.pop(0)
            if each.declares is not None:
                found.setdefault(each.declares, each)
            waiting[:0] = each.get_sub_entities()
        return list(found.values())


def normalize_to_list_of_substitutions(value: SomeSubstitutionsType) -> list[Any]:
    """Return a text, a substitution or several of them as a list."""
    return [value] if isinstance(value, (str, os.PathLike, Substitution)) else list(value)


def perform_substitutions(context: LaunchContext, value: SomeSubstitutionsType) -> str:
    """Return the joined values of substitutions."""
    return text(context, value)
