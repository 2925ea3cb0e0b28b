"""`launch.events`: what can happen while a launch runs."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from typing import Any

from rwt_rclpy.launch.entities import Action, ActionEvent, Event, LaunchDescription
from rwt_rclpy.launch.entities import ExecutionComplete as ExecutionComplete

ProcessMatcher = Callable[[Action], bool]


class Shutdown(Event):
    """The launch ends.

    Attributes:
        reason: why.
        due_to_sigint: whether Ctrl-C ends it, which a terminal sends to all of its processes.
    """

    name = "launch.events.Shutdown"

    def __init__(self, *, reason: str = "reason not given", due_to_sigint: bool = False, **_: object) -> None:
        self.reason = reason
        self.due_to_sigint = due_to_sigint


class TimerEvent(Event):
    """A timer's time has come."""

    name = "launch.events.TimerEvent"

    def __init__(self, *, timer_action: Any) -> None:
        self.timer_action = timer_action


class IncludeLaunchDescription(Event):
    """A description is to be visited."""

    name = "launch.events.IncludeLaunchDescription"

    def __init__(self, launch_description: LaunchDescription) -> None:
        self.launch_description = launch_description


class ProcessEvent(ActionEvent):
    """Something happened to a process.

    Attributes:
        process_name, pid: which.
        cmd, cwd, env: how it was started.
    """

    def __init__(
        self, *, action: Action, name: str, cmd: list[str], cwd: str | None, env: Mapping[str, str], pid: int
    ) -> None:
        super().__init__(action=action)
        self.process_name = name
        self.cmd = cmd
        self.cwd = cwd
        self.env = env
        self.pid = pid


class ProcessStarted(ProcessEvent):
    """A process has started."""

    name = "launch.events.process.ProcessStarted"


class ProcessExited(ProcessEvent):
    """A process has ended.

    Attributes:
        returncode: its exit code; a signal's number, negative, when a signal ended it.
    """

    name = "launch.events.process.ProcessExited"

    def __init__(self, *, returncode: int, **process: Any) -> None:
        super().__init__(**process)
        self.returncode = returncode


class ProcessIO(ProcessEvent):
    """A process has printed something.

    Attributes:
        text: what, with its line's end.
        from_stdout, from_stderr: where.
    """

    name = "launch.events.process.ProcessIO"
    from_stdout = False
    from_stderr = False
    from_stdin = False

    def __init__(self, *, text: bytes, **process: Any) -> None:
        super().__init__(**process)
        self.text = text


class ProcessStdout(ProcessIO):
    """A process has printed something on its standard output."""

    from_stdout = True


class ProcessStderr(ProcessIO):
    """A process has printed something on its standard error."""

    from_stderr = True


class ShutdownProcess(Event):
    """Some processes are to end."""

    name = "launch.events.process.ShutdownProcess"

    def __init__(self, *, process_matcher: ProcessMatcher) -> None:
        self.process_matcher = process_matcher


class SignalProcess(Event):
    """Some processes are to get a signal."""

    name = "launch.events.process.SignalProcess"

    def __init__(self, *, signal_number: str | int | signal.Signals, process_matcher: ProcessMatcher) -> None:
        self.signal = (
            signal.Signals[signal_number] if isinstance(signal_number, str) else signal.Signals(signal_number)
        )
        self.signal_name = self.signal.name
        self.process_matcher = process_matcher


def matches_action(target_action: Action) -> ProcessMatcher:
    """Picks the process of an action."""
    return lambda action: action is target_action


def matches_executable(executable: str) -> ProcessMatcher:
    """Picks processes by the name of their program."""
    return lambda action: getattr(action, "executable", None) == executable


def matches_name(name: str) -> ProcessMatcher:
    """Picks processes by their name, without its number."""
    return lambda action: getattr(action, "name", "").rpartition("-")[0] == name


def matches_pid(pid: int) -> ProcessMatcher:
    """Picks a process by its number."""
    return lambda action: getattr(action, "pid", None) == pid
