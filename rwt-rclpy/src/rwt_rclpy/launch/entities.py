"""Entities of launch descriptions, and the context in which they are visited.

An entity is visited once. It gives what is to be visited next, before what stands after it, and perhaps a
future, for which the launch waits before it takes itself for idle.
"""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import Iterable, MutableMapping, Sequence
from typing import Any, Protocol, TypeAlias, TypeVar

from rwt_participant.errors import RobotError

_Value = TypeVar("_Value")


class LaunchError(RobotError, RuntimeError):
    """A launch description asks for what cannot be; says what, and what would do."""


class Substitution:
    """A text that is known when the launch gets there."""

    def describe(self) -> str:
        """Return a description for people."""
        return type(self).__name__

    def perform(self, context: LaunchContext) -> str:
        """The text. Raises SubstitutionFailure."""
        raise NotImplementedError


SomeSubstitutionsType: TypeAlias = str | os.PathLike[str] | Substitution | Iterable[Any]
#: What may stand where launch files give a text.
SomeText: TypeAlias = SomeSubstitutionsType | int | float


def text(context: LaunchContext, value: SomeText) -> str:
    """Return the joined value of a string, a number, a substitution or a list of them.

    Raises:
        LaunchError: it is none of these.
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
        LaunchError: it says neither.
    """
    said = (str(value) if isinstance(value, bool) else text(context, value)).strip().lower()
    if said in ("true", "1"):
        return True
    if said in ("false", "0"):
        return False
    raise LaunchError(f"a condition must be true, 1, false or 0, got {said!r}")


class Event:
    """Something that happened, for event handlers."""

    name = "launch.Event"


class ActionEvent(Event):
    """Something happened to an action."""

    def __init__(self, *, action: Action) -> None:
        self.action = action


class ExecutionComplete(ActionEvent):
    """An action is done."""

    name = "launch.events.ExecutionComplete"


class Decides(Protocol):
    """A condition."""

    def evaluate(self, context: LaunchContext) -> bool:
        """True if the condition holds."""
        ...


class Hears(Protocol):
    """An event handler."""

    def matches(self, event: Event) -> bool:
        """True if the handler handles the event."""
        ...

    def handle(self, event: Event, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Handle the event; returns the entities to visit next."""
        ...


class Locals:
    """Values that are available while one event is handled, by attribute."""

    def __init__(self, values: dict[str, Any]) -> None:
        self.__dict__.update(values)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"there is no {name!r} here: only while an event is handled, or in a file")


class LaunchContext:
    """State of the visit of a description: configurations, environment, handlers and events.

    Attributes:
        argv: the command line.
        noninteractive: whether Ctrl-C reaches this process alone, and not the processes that it started.
        launch_configurations: the values of arguments and what actions set, by name.
        is_shutdown: whether the launch ends.
    """

    def __init__(self, *, argv: Sequence[str] | None = None, noninteractive: bool = False) -> None:
        self.argv = list(argv or ())
        self.noninteractive = noninteractive
        self.launch_configurations: dict[str, Any] = {}
        self.is_shutdown = False
        self.handlers: deque[Hears] = deque()
        self.events: deque[Event] = deque()
        #: What this process is asked for so far by one name, for the numbers of processes.
        self.process_count = 0
        self.news = asyncio.Event()
        self._locals: list[dict[str, Any]] = [{}]
        self._configurations: list[dict[str, Any]] = []
        self._environments: list[dict[str, str]] = []
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def environment(self) -> MutableMapping[str, str]:
        """The environment of what is started: that of this process."""
        return os.environ

    @property
    def asyncio_loop(self) -> asyncio.AbstractEventLoop:
        """The loop that runs the launch. Raises LaunchError while none does."""
        if self._loop is None:
            raise LaunchError("the launch does not run")
        return self._loop

    def begin(self) -> None:
        """Run in the present loop from now on."""
        self._loop, self.news = asyncio.get_running_loop(), asyncio.Event()
        self.is_shutdown = False

    @property
    def locals(self) -> Locals:
        """Values that are available while the present event is handled."""
        return Locals(self._locals[-1])

    def get_locals_as_dict(self) -> dict[str, Any]:
        """The same by name."""
        return self._locals[-1]

    def extend_locals(self, values: dict[str, Any]) -> None:
        """Add to them."""
        self._locals[-1].update(values)

    def push_locals(self) -> None:
        """Keep what is known, to be had again by :meth:`pop_locals`."""
        self._locals.append(dict(self._locals[-1]))

    def pop_locals(self) -> None:
        """Forget what came to be known since :meth:`push_locals`."""
        self._locals.pop()

    def push_configurations(self) -> None:
        """Keep the configurations as they are, to be had again."""
        self._configurations.append(dict(self.launch_configurations))

    def pop_configurations(self) -> None:
        """Take back what was set since they were kept."""
        self.launch_configurations = _last(self._configurations, "launch configurations")

    def push_environment(self) -> None:
        """Keep the environment as it is, to be had again."""
        self._environments.append(dict(os.environ))

    def pop_environment(self) -> None:
        """Take back what was set since it was kept."""
        kept = _last(self._environments, "environment")
        os.environ.clear()
        os.environ.update(kept)

    def perform_substitution(self, value: SomeSubstitutionsType) -> str:
        """Return the value of a substitution."""
        return text(self, value)

    def register_event_handler(self, handler: Hears, append: bool = False) -> None:
        """Hear of events from now on; before those that do already, unless `append`."""
        if append:
            self.handlers.append(handler)
        else:
            self.handlers.appendleft(handler)

    def unregister_event_handler(self, handler: Hears) -> None:
        """Hear of no more. Raises ValueError when it was not registered."""
        self.handlers.remove(handler)

    def would_handle_event(self, event: Event) -> bool:
        """True if a handler handles the event."""
        return any(handler.matches(event) for handler in self.handlers)

    def emit_event_sync(self, event: Event) -> None:
        """Let it be handled after those that wait already."""
        self.events.append(event)
        self.news.set()

    async def emit_event(self, event: Event) -> None:
        """:meth:`emit_event_sync` for coroutines."""
        self.emit_event_sync(event)


def _last(kept: list[_Value], what: str) -> _Value:
    if not kept:
        raise LaunchError(f"nothing was pushed of the {what}, and so there is nothing to pop")
    return kept.pop()


class LaunchDescriptionEntity:
    """Base class of the entities of a launch description.

    Attributes:
        declares: the name of the argument that it declares, if it does.
    """

    declares: str | None = None

    def visit(self, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Do what it is for; gives what is visited next."""
        raise NotImplementedError

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """Return a future that is done with the entity, if its work takes a while."""
        return None

    def get_sub_entities(self) -> Iterable[LaunchDescriptionEntity]:
        """Return the entities inside, as far as they are known before the visit."""
        return ()


SomeEntitiesType: TypeAlias = LaunchDescriptionEntity | Iterable[LaunchDescriptionEntity]


def entities_of(some: object) -> list[LaunchDescriptionEntity]:
    """Entities as a list: one, several or none.

    Raises:
        LaunchError: there is something else among them.
    """
    given = [] if some is None else some if isinstance(some, Iterable) else [some]
    found: list[LaunchDescriptionEntity] = []
    for each in given:
        if not isinstance(each, LaunchDescriptionEntity):
            raise LaunchError(f"expected actions or launch descriptions, got {each!r}")
        found.append(each)
    return found


class Action(LaunchDescriptionEntity):
    """Something to do.

    Args:
        condition: whether it is done; always by default.
    """

    def __init__(self, *, condition: Decides | None = None) -> None:
        self.condition = condition

    def visit(self, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Do it, if its condition holds, and tell who waits for its end."""
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
        """Do it; gives what is visited next."""
        return None


class LaunchDescription(LaunchDescriptionEntity):
    """Entities of a launch file, in order.

    Attributes:
        entities: what it holds.
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
        """Add to it at the end."""
        self.entities.extend(entities_of(action))

    add_entity = add_action

    def get_launch_arguments(self) -> list[Any]:
        """Every argument that it declares, as far as that is known before it is visited."""
        found: dict[str, LaunchDescriptionEntity] = {}
        waiting: list[LaunchDescriptionEntity] = [self]
        while waiting:
            each = waiting.pop(0)
            if each.declares is not None:
                found.setdefault(each.declares, each)
            waiting[:0] = each.get_sub_entities()
        return list(found.values())


def normalize_to_list_of_substitutions(value: SomeSubstitutionsType) -> list[Any]:
    """A text, a substitution or several of them as a list."""
    return [value] if isinstance(value, (str, os.PathLike, Substitution)) else list(value)


def perform_substitutions(context: LaunchContext, value: SomeSubstitutionsType) -> str:
    """Return the joined values of substitutions."""
    return text(context, value)
