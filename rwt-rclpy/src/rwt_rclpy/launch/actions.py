"""`launch.actions`: actions of launch files besides starting nodes."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar

from rwt_rclpy.launch.entities import (
    Action,
    Event,
    LaunchContext,
    LaunchDescriptionEntity,
    LaunchError,
    SomeEntitiesType,
    SomeSubstitutionsType,
    SomeText,
    entities_of,
    text,
    truth,
)
from rwt_rclpy.launch.event_handlers import EventHandler, OnShutdown
from rwt_rclpy.launch.events import ProcessExited, TimerEvent
from rwt_rclpy.launch.events import Shutdown as ShutdownEvent
from rwt_rclpy.launch.logging import get_logger
from rwt_rclpy.launch.processes import ExecuteLocal as ExecuteLocal
from rwt_rclpy.launch.processes import ExecuteProcess as ExecuteProcess
from rwt_rclpy.launch.sources import LaunchDescriptionSource, PythonLaunchDescriptionSource


class DeclareLaunchArgument(Action):
    """Declaration of an argument of a description, with its default."""

    def __init__(
        self,
        name: str,
        *,
        default_value: SomeText | None = None,
        description: str | None = None,
        choices: Sequence[str] | None = None,
        **action: Any,
    ) -> None:
        super().__init__(**action)
        if choices is not None and not choices:
            raise LaunchError(f"argument {name!r} has an empty list of choices; leave it out for any value")
        self.name = self.declares = name
        self.default_value = default_value
        self.description = description or (f"one of {', '.join(choices)}" if choices else "")
        self.choices = choices

    def execute(self, context: LaunchContext) -> None:
        """Set the given value or the default. Raises LaunchError if there is none, or it is not a choice."""
        values = context.launch_configurations
        if self.name not in values:
            if self.default_value is None:
                about = f" ({self.description})" if self.description else ""
                raise LaunchError(
                    f"launch argument {self.name!r}{about} is required: give {self.name}:=VALUE"
                )
            values[self.name] = text(context, self.default_value)
        if self.choices is not None and values[self.name] not in self.choices:
            raise LaunchError(
                f"launch argument {self.name!r} is {values[self.name]!r}; it must be one of"
                f" {', '.join(self.choices)}"
            )


class _Unset(Action):
    """Action that removes a value, if it exists."""

    _values: ClassVar[str]

    def __init__(self, name: SomeSubstitutionsType, **action: Any) -> None:
        super().__init__(**action)
        self.name = name

    def execute(self, context: LaunchContext) -> None:
        """Execute the action."""
        getattr(context, self._values).pop(text(context, self.name), None)


class _Set(_Unset):
    """Action that sets a value."""

    def __init__(self, name: SomeSubstitutionsType, value: SomeText, **action: Any) -> None:
        super().__init__(name, **action)
        self.value = value

    def execute(self, context: LaunchContext) -> None:
        """Execute the action."""
        getattr(context, self._values)[text(context, self.name)] = text(context, self.value)


class SetLaunchConfiguration(_Set):
    """Action that sets a configuration."""

    _values = "launch_configurations"


class UnsetLaunchConfiguration(_Unset):
    """Action that removes a configuration, if it exists."""

    _values = "launch_configurations"


class PushLaunchConfigurations(Action):
    """Action that saves the configurations."""

    def execute(self, context: LaunchContext) -> None:
        """Execute the action."""
        context.push_configurations()


class PopLaunchConfigurations(Action):
    """Action that restores the saved state."""

    def execute(self, context: LaunchContext) -> None:
        """Execute the action."""
        context.pop_configurations()


class PushEnvironment(Action):
    """Action that saves the environment."""

    def execute(self, context: LaunchContext) -> None:
        """Execute the action."""
        context.push_environment()


class PopEnvironment(Action):
    """Action that restores the saved state."""

    def execute(self, context: LaunchContext) -> None:
        """Execute the action."""
        context.pop_environment()


class ResetLaunchConfigurations(Action):
    """Action that removes all configurations except the given ones."""

    def __init__(self, launch_configurations: Mapping[Any, SomeText] | None = None, **action: Any) -> None:
        super().__init__(**action)
        self.launch_configurations = dict(launch_configurations or {})

    def execute(self, context: LaunchContext) -> None:
        """Remove the others; the given ones are evaluated before."""
        kept = {text(context, name): text(context, each) for name, each in self.launch_configurations.items()}
        context.launch_configurations.clear()
        context.launch_configurations.update(kept)


class SetEnvironmentVariable(_Set):
    """Action that sets an environment variable."""

    _values = "environment"


class UnsetEnvironmentVariable(_Unset):
    """Action that removes an environment variable, if it exists."""

    _values = "environment"


class AppendEnvironmentVariable(SetEnvironmentVariable):
    """Action that extends a variable with a list of paths."""

    def __init__(
        self,
        name: SomeSubstitutionsType,
        value: SomeText,
        prepend: bool | SomeText = False,
        separator: SomeText = os.pathsep,
        **action: Any,
    ) -> None:
        super().__init__(name, value, **action)
        self.prepend = prepend
        self.separator = separator

    def execute(self, context: LaunchContext) -> None:
        """Extend the variable at the end or the beginning."""
        name, value = text(context, self.name), text(context, self.value)
        present = context.environment.get(name)
        parts = [value] if present is None else [present, value]
        if truth(context, self.prepend):
            parts.reverse()
        context.environment[name] = text(context, self.separator).join(parts)


class GroupAction(Action):
    """Group of actions with one condition; its settings end with it, unless `scoped` is false."""

    def __init__(
        self,
        actions: Iterable[LaunchDescriptionEntity],
        *,
        scoped: bool = True,
        forwarding: bool = True,
        launch_configurations: Mapping[Any, SomeText] | None = None,
        **action: Any,
    ) -> None:
        super().__init__(**action)
        own = dict(launch_configurations or {})
        first: list[LaunchDescriptionEntity] = [SetLaunchConfiguration(*each) for each in own.items()]
        last: list[LaunchDescriptionEntity] = []
        if scoped and not forwarding:
            first = [ResetLaunchConfigurations(own)]
        if scoped:
            first = [PushLaunchConfigurations(), PushEnvironment(), *first]
            last = [PopEnvironment(), PopLaunchConfigurations()]
        self.entities = [*first, *entities_of(actions), *last]

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        """Return the actions."""
        return self.entities

    def execute(self, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        """Return the actions."""
        return self.entities


class IncludeLaunchDescription(Action):
    """Action that visits the description of another launch file.

    Args:
        launch_description_source: source, or path of a Python launch file.
        launch_arguments: pairs of a name and a value.
    """

    def __init__(
        self,
        launch_description_source: LaunchDescriptionSource | SomeSubstitutionsType,
        *,
        launch_arguments: Iterable[tuple[SomeSubstitutionsType, SomeText]] | None = None,
        **action: Any,
    ) -> None:
        super().__init__(**action)
        self.source = (
            launch_description_source
            if isinstance(launch_description_source, LaunchDescriptionSource)
            else PythonLaunchDescriptionSource(launch_description_source)
        )
        self.launch_arguments = tuple(launch_arguments or ())

    def execute(self, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        """Set the arguments, and return the description."""
        description = self.source.get_launch_description(context)
        set_arguments = [SetLaunchConfiguration(name, value) for name, value in self.launch_arguments]
        before = {
            name: context.get_locals_as_dict().get(name)
            for name in ("current_launch_file_path", "current_launch_file_directory")
        }
        path = os.path.abspath(self.source.location)
        context.extend_locals(
            {"current_launch_file_path": path, "current_launch_file_directory": os.path.dirname(path)}
        )
        return [*set_arguments, description, OpaqueFunction(lambda within: within.extend_locals(before))]


class RegisterEventHandler(Action):
    """Action that registers an event handler."""

    def __init__(self, event_handler: EventHandler, **action: Any) -> None:
        super().__init__(**action)
        self.event_handler = event_handler

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        """Return the entities of the handler."""
        return self.event_handler.entities

    def execute(self, context: LaunchContext) -> None:
        """Register it."""
        context.register_event_handler(self.event_handler)


class UnregisterEventHandler(RegisterEventHandler):
    """Action that unregisters an event handler."""

    def execute(self, context: LaunchContext) -> None:
        """Unregister it."""
        context.unregister_event_handler(self.event_handler)


class EmitEvent(Action):
    """Action that emits an event."""

    def __init__(self, *, event: Event, **action: Any) -> None:
        super().__init__(**action)
        self.event = event

    def execute(self, context: LaunchContext) -> None:
        """Emit it."""
        context.emit_event_sync(self.event)


class Shutdown(Action):
    """Action that ends the launch; also for `on_exit` of a process."""

    def __init__(self, *, reason: SomeText = "reason not given", **action: Any) -> None:
        super().__init__(**action)
        self.reason = reason

    def execute(self, context: LaunchContext) -> None:
        """End the launch; after a process, the reason contains its name."""
        event = context.get_locals_as_dict().get("event")
        reason = text(context, self.reason)
        if isinstance(event, ProcessExited):
            reason = f"process[{event.process_name}] was required: shutting down launched system"
            get_logger("launch").error(reason)
        context.emit_event_sync(ShutdownEvent(reason=reason))


class OpaqueFunction(Action):
    """Action that calls a function with the context; it may return actions to visit."""

    def __init__(
        self,
        function: Callable[..., SomeEntitiesType | None],
        *,
        args: Iterable[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
        **action: Any,
    ) -> None:
        super().__init__(**action)
        self.function = function
        self.args = tuple(args)
        self.kwargs = dict(kwargs or {})

    def execute(self, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        """Call the function."""
        return entities_of(self.function(context, *self.args, **self.kwargs))


class OpaqueCoroutine(Action):
    """Action that runs a coroutine during the launch; it is cancelled at the end."""

    def __init__(
        self,
        *,
        coroutine: Callable[..., Any],
        args: Iterable[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
        ignore_context: bool = False,
        **action: Any,
    ) -> None:
        super().__init__(**action)
        self.coroutine = coroutine
        self.args = tuple(args)
        self.kwargs = dict(kwargs or {})
        self.ignore_context = ignore_context
        self._task: asyncio.Task[None] | None = None

    def execute(self, context: LaunchContext) -> None:
        """Start the action."""
        first = () if self.ignore_context else (context,)
        task = context.asyncio_loop.create_task(self.coroutine(*first, *self.args, **self.kwargs))
        context.register_event_handler(OnShutdown(on_shutdown=lambda event, within: _cancel(task)))
        self._task = task

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """Return a future that is done at its end."""
        return self._task


def _cancel(task: asyncio.Task[None]) -> None:
    task.cancel()


class LogInfo(Action):
    """Action that logs a text."""

    def __init__(self, *, msg: SomeText, **action: Any) -> None:
        super().__init__(**action)
        self.msg = msg

    def execute(self, context: LaunchContext) -> None:
        """Log the text."""
        get_logger("launch.user").info(text(context, self.msg))


class TimerAction(Action):
    """Action that visits others after a delay, unless it is cancelled.

    Args:
        period: delay in seconds, of this machine's clock.
        actions: actions to visit.
        cancel_on_shutdown: True if the end of the launch cancels it.
    """

    def __init__(
        self,
        *,
        period: SomeText,
        actions: Iterable[LaunchDescriptionEntity],
        cancel_on_shutdown: bool | SomeText = True,
        **action: Any,
    ) -> None:
        super().__init__(**action)
        self.period = period
        self.actions = entities_of(actions)
        self.cancel_on_shutdown = cancel_on_shutdown
        self._done: asyncio.Future[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._locals: dict[str, Any] = {}
        self._is_cancelled = False

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        """Return the actions."""
        return self.actions

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """Return a future that is done at its end."""
        return self._done

    def cancel(self) -> None:
        """Cancel the timer, if it is pending."""
        self._is_cancelled = True
        if self._timer is not None:
            self._timer.cancel()
        if self._done is not None and not self._done.done():
            self._done.set_result(None)

    def execute(self, context: LaunchContext) -> None:
        """Start the action."""
        if self._is_cancelled:
            return
        self._locals = dict(context.get_locals_as_dict())
        self._done = context.asyncio_loop.create_future()
        handler = EventHandler(
            matcher=lambda event: isinstance(event, TimerEvent) and event.timer_action is self,
            entities=OpaqueFunction(self._fire),
            handle_once=True,
        )
        context.register_event_handler(handler)
        try:
            seconds = float(text(context, self.period))
        except ValueError as error:
            raise LaunchError(f"the period of a timer is in seconds: {error}") from None
        self._timer = context.asyncio_loop.call_later(
            seconds, context.emit_event_sync, TimerEvent(timer_action=self)
        )
        if truth(context, self.cancel_on_shutdown):
            context.register_event_handler(OnShutdown(on_shutdown=lambda event, within: self.cancel()))

    def _fire(self, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        if self._done is None or self._done.done():
            return []
        self._done.set_result(None)
        context.extend_locals(self._locals)
        return self.actions
