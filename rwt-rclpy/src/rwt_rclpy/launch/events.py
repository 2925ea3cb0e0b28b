"""`launch.events`: events of a launch."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from typing import Any

from rwt_rclpy.launch.entities import Action, ActionEvent, Event, LaunchDescription
from rwt_rclpy.launch.entities import ExecutionComplete as ExecutionComplete

ProcessMatcher = Callable[[Action], bool]


class Shutdown(Event):
    """Event: the launch ends.

    Attributes:
        reason: reason.
        due_to_sigint: True after Ctrl-C, which a terminal sends to all of its processes.
    """

    name = "launch.events.Shutdown"

    def __init__(self, *, reason: str = "reason not given", due_to_sigint: bool = False, **_: object) -> None:
        self.reason = reason
        self.due_to_sigint = due_to_sigint


class TimerEvent(Event):
    """Event: a timer is due."""

    name = "launch.events.TimerEvent"

    def __init__(self, *, timer_action: Any) -> None:
        self.timer_action = timer_action


class IncludeLaunchDescription(Event):
    """Event: request to visit a description."""

    name = "launch.events.IncludeLaunchDescription"

    def __init__(self, launch_description: LaunchDescription) -> None:
        self.launch_description = launch_description


class ProcessEvent(ActionEvent):
    """Event of a process.

    Attributes:
        process_name, pid: process.
        cmd, cwd, env: command, folder and environment of the process.
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
    """Event: a process has started."""

    name = "launch.events.process.ProcessStarted"


class ProcessExited(ProcessEvent):
    """Event: a process has ended.

    Attributes:
        returncode: exit code; the negative number of a signal that ended it.
    """

    name = "launch.events.process.ProcessExited"

    def __init__(self, *, returncode: int, **process: Any) -> None:
        super().__init__(**process)
        self.returncode = returncode


class ProcessIO(ProcessEvent):
    """Event: a process has written output.

    Attributes:
        text: text with its line end.
        from_stdout, from_stderr: stream.
    """

    name = "launch.events.process.ProcessIO"
    from_stdout = False
    from_stderr = False
    from_stdin = False

    def __init__(self, *, text: bytes, **process: Any) -> None:
        super().__init__(**process)
        self.text = text


class ProcessStdout(ProcessIO):
    """Event: a process has written to its standard output."""

    from_stdout = True


class ProcessStderr(ProcessIO):
    """Event: a process has written to its standard error."""

    from_stderr = True


class ShutdownProcess(Event):
    """Event: request to end some processes."""

    name = "launch.events.process.ShutdownProcess"

    def __init__(self, *, process_matcher: ProcessMatcher) -> None:
        self.process_matcher = process_matcher


class SignalProcess(Event):
    """Event: request to send a signal to some processes."""

    name = "launch.events.process.SignalProcess"

    def __init__(self, *, signal_number: str | int | signal.Signals, process_matcher: ProcessMatcher) -> None:
        self.signal = (
            signal.Signals[signal_number] if isinstance(signal_number, str) else signal.Signals(signal_number)
        )
        self.signal_name = self.signal.name
        self.process_matcher = process_matcher


def matches_action(target_action: Action) -> ProcessMatcher:
    """Return a matcher of the process of an action."""
    return lambda action: action is target_action


def matches_executable(executable: str) -> ProcessMatcher:
    """Return a matcher of processes by the name of their program."""
    return lambda action: getattr(action, "executable", None) == executable


def matches_name(name: str) -> ProcessMatcher:
    """Return a matcher of processes by name, without number."""
    return lambda action: getattr(action, "name", "").rpartition("-")[0] == name


def matches_pid(pid: int) -> ProcessMatcher:
    """Return a matcher of a process by its number."""
    return lambda action: getattr(action, "pid", None) == pid
