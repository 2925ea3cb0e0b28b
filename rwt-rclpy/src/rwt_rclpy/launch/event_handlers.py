"""`launch.event_handlers`: handlers of events."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, ClassVar

from rwt_rclpy.launch.entities import (
    Action,
    ActionEvent,
    Event,
    ExecutionComplete,
    LaunchContext,
    LaunchDescriptionEntity,
    SomeEntitiesType,
    entities_of,
)
from rwt_rclpy.launch.entities import EventHandler as EventHandler
from rwt_rclpy.launch.events import (
    ProcessExited,
    ProcessIO,
    ProcessStarted,
    Shutdown,
)

#: Actions, or a function of the event and the context that may return some.
OnEvent = SomeEntitiesType | Callable[..., Any]


BaseEventHandler = EventHandler


class OnMatch(EventHandler):
    """Handler that visits actions, or calls a function."""

    def __init__(
        self, matcher: Callable[[Event], bool], on_event: OnEvent | None, handle_once: bool = False
    ) -> None:
        self.on_event = on_event if callable(on_event) else None
        super().__init__(
            matcher=matcher, entities=None if callable(on_event) else on_event, handle_once=handle_once
        )

    def handle(self, event: Event, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Return the entities to visit."""
        entities = super().handle(event, context)
        return entities if self.on_event is None else entities_of(self.on_event(event, context))


class _OnAction(OnMatch):
    """Handler of the events of one action, of those that a function selects, or of all."""

    event_class: ClassVar[type[ActionEvent]]

    def __init__(
        self,
        target: Action | Callable[[Action], bool] | None,
        on_event: OnEvent | None,
        handle_once: bool = False,
    ) -> None:
        def fits(event: Event) -> bool:
            if not isinstance(event, self.event_class):
                return False
            if target is None or event.action is target:
                return True
            return not isinstance(target, Action) and bool(target(event.action))

        super().__init__(fits, on_event, handle_once)


class OnProcessStart(_OnAction):
    """Handler of the start of a process."""

    event_class = ProcessStarted

    def __init__(
        self, *, target_action: Any = None, on_start: OnEvent | None = None, handle_once: bool = False
    ) -> None:
        super().__init__(target_action, on_start, handle_once)


class OnProcessExit(_OnAction):
    """Handler of the end of a process."""

    event_class = ProcessExited

    def __init__(
        self, *, target_action: Any = None, on_exit: OnEvent | None = None, handle_once: bool = False
    ) -> None:
        super().__init__(target_action, on_exit, handle_once)


class OnExecutionComplete(_OnAction):
    """Handler of the end of an action."""

    event_class = ExecutionComplete

    def __init__(
        self, *, target_action: Any = None, on_completion: OnEvent | None = None, handle_once: bool = False
    ) -> None:
        super().__init__(target_action, on_completion, handle_once)


class OnProcessIO(_OnAction):
    """Handler of the output of a process; each function gets the event."""

    event_class = ProcessIO

    def __init__(
        self,
        *,
        target_action: Any = None,
        on_stdin: Callable[[ProcessIO], Any] | None = None,
        on_stdout: Callable[[ProcessIO], Any] | None = None,
        on_stderr: Callable[[ProcessIO], Any] | None = None,
        handle_once: bool = False,
    ) -> None:
        def tell(event: ProcessIO, context: LaunchContext) -> Any:
            call = on_stdout if event.from_stdout else on_stderr
            return None if call is None else call(event)

        super().__init__(target_action, tell, handle_once)


class OnShutdown(OnMatch):
    """Handler of the end of the launch."""

    def __init__(self, *, on_shutdown: OnEvent, handle_once: bool = False) -> None:
        super().__init__(lambda event: isinstance(event, Shutdown), on_shutdown, handle_once)
