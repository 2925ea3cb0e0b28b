"""`rclpy.logging` and the logger of a node, with its filters `once`, `throttle_duration_sec` and
`skip_first`."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final

from rwt_rclpy.clocks.clock import Clock
from rwt_rclpy.logs import output
from rwt_rclpy.logs.output import LoggingSeverity
from rwt_rclpy.release import FROM_KILTED

_OPTIONS: Final = ("once", "skip_first", "throttle_duration_sec", "throttle_time_source_type")


@dataclass(slots=True)
class _Call:
    """Filter state of one call site."""

    severity: LoggingSeverity
    name: str
    options: dict[str, Any]
    clock: Clock | None = None
    seen: int = 0
    #: As in rcutils: a clock that starts at zero counts as logged at zero.
    last_ns: int = 0

    def passes(self) -> bool:
        """True if the filters pass the line this time."""
        self.seen += 1
        if "throttle_duration_sec" in self.options and not self._is_due():
            return False
        if self.options.get("skip_first") and self.seen == 1:
            return False
        if self.options.get("once"):
            return self.seen == (2 if self.options.get("skip_first") else 1)
        return True

    def _is_due(self) -> bool:
        assert self.clock is not None  # Throttled calls have a clock.
        now = self.clock.now().nanoseconds
        span = self.options["throttle_duration_sec"] * 1e9
        if self.last_ns <= now < self.last_ns + span:
            return False
        self.last_ns = now
        return True


class RcutilsLogger:
    """Logger of one name.

    Attributes:
        name: dotted name; empty for the root.
        logger_sublogger_namepair: names of the parent and of the part; None below the root.
    """

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.contexts: dict[tuple[str, int, int], _Call] = {}
        self.logger_sublogger_namepair: tuple[str, str] | None = None

    def get_child(self, name: str) -> RcutilsLogger:
        """Return the logger of a name below this one. Raises ValueError for an empty one."""
        if not name:
            raise ValueError("Child logger name must not be empty.")
        child = RcutilsLogger(f"{self.name}{output.SEPARATOR}{name}" if self.name else name)
        child.logger_sublogger_namepair = (self.name, name) if self.name else None
        return child

    def set_level(self, level: int) -> None:
        """Set the level."""
        output.set_level(self.name, LoggingSeverity(level))

    def get_effective_level(self) -> LoggingSeverity:
        """Return the effective level: the logger's own, or that of a logger above."""
        return output.effective_level(self.name)

    def is_enabled_for(self, severity: int) -> bool:
        """True if lines of a severity are logged."""
        return LoggingSeverity(severity) >= self.get_effective_level()

    def log(self, message: str, severity: int, **kwargs: Any) -> bool:
        """Log a line.

        Args:
            message: text.
            severity: level.
            **kwargs: filters: `once`, `skip_first`, `throttle_duration_sec` with
                `throttle_time_source_type`, and `name` of another logger.

        Returns:
            True if it was logged.

        Raises:
            TypeError: a filter is unknown, or lacks a parameter.
            ValueError: this call site used other filters before.
        """
        if not self.is_enabled_for(severity):
            return False
        severity = LoggingSeverity(severity)
        name = kwargs.pop("name", self.name)
        _check(kwargs)
        kwargs = {option: value for option, value in kwargs.items() if value is not False}
        frame = _caller()
        key = (frame.f_code.co_filename, frame.f_lineno, frame.f_lasti)
        call = self.contexts.get(key)
        if call is None:
            call = self.contexts[key] = _Call(severity, name, dict(kwargs), _clock_of(kwargs))
        else:
            _check_unchanged(call, severity, name, kwargs)
        if kwargs and not call.passes():
            return False
        output.write(
            severity, name, _text(message), frame.f_code.co_name, frame.f_code.co_filename, frame.f_lineno
        )
        return True

    def debug(self, message: str, **kwargs: Any) -> bool:
        """Log a line for debugging."""
        return self.log(message, LoggingSeverity.DEBUG, **kwargs)

    def info(self, message: str, **kwargs: Any) -> bool:
        """Log information."""
        return self.log(message, LoggingSeverity.INFO, **kwargs)

    def warning(self, message: str, **kwargs: Any) -> bool:
        """Log a warning."""
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def warn(self, message: str, **kwargs: Any) -> bool:
        """Log a warning (older name)."""
        if FROM_KILTED:
            warnings.warn("Function warn() is deprecated, use warning()", DeprecationWarning, stacklevel=2)
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def error(self, message: str, **kwargs: Any) -> bool:
        """Log an error."""
        return self.log(message, LoggingSeverity.ERROR, **kwargs)

    def fatal(self, message: str, **kwargs: Any) -> bool:
        """Log a fatal error."""
        return self.log(message, LoggingSeverity.FATAL, **kwargs)


def _text(message: object) -> str:
    """Return a message as rclpy's C part takes it. Raises TypeError for what is not text."""
    if message is None:
        return "(null)"
    if not isinstance(message, (str, bytes)):
        raise TypeError(
            f"a message of a logger is a str, not {type(message).__name__}; use str() or an f-string"
        )
    return message.decode() if isinstance(message, bytes) else message


def _check(options: dict[str, Any]) -> None:
    for name in options:
        if name not in _OPTIONS:
            raise TypeError(f'parameter "{name}" is not one of the recognized logging options "{_OPTIONS}"')
    if "throttle_time_source_type" in options and "throttle_duration_sec" not in options:
        raise TypeError(
            'required parameter "throttle_duration_sec" not specified beside "throttle_time_source_type"'
        )


def _clock_of(options: dict[str, Any]) -> Clock | None:
    if "throttle_duration_sec" not in options:
        return None
    if options["throttle_duration_sec"] is None:
        raise TypeError("throttle_duration_sec is not given")
    clock = options.get("throttle_time_source_type")
    if clock is None:
        return Clock()
    if not isinstance(clock, Clock):
        raise ValueError(f"throttle_time_source_type: {clock!r} is not a clock instance")
    return clock


def _check_unchanged(call: _Call, severity: LoggingSeverity, name: str, options: dict[str, Any]) -> None:
    if severity != call.severity:
        raise ValueError("Logger severity cannot be changed between calls.")
    if name != call.name:
        raise ValueError("Logger name cannot be changed between calls.")
    if set(options) != set(call.options):
        raise ValueError("Requested logging filters cannot be changed between calls.")
    if options != call.options:
        raise ValueError("Logging filter parameters cannot be changed between calls.")


def _caller() -> FrameType:
    """Return the first stack frame outside of this module."""
    frame: FrameType | None = sys._getframe(2)
    while frame is not None and frame.f_code.co_filename == __file__ and frame.f_back is not None:
        frame = frame.f_back
    assert frame is not None  # The outermost frame.
    return frame


_root_logger = RcutilsLogger()


def get_logger(name: str) -> RcutilsLogger:
    """Return the logger of a name. Raises ValueError for an empty one."""
    if not name:
        raise ValueError("Logger name must not be empty.")
    return _root_logger.get_child(name)


def initialize() -> None:
    """No-op: logging needs no initialisation."""


def shutdown() -> None:
    """No-op: logging holds no resources."""


def clear_config() -> None:
    """Reset all levels."""
    output.clear_levels()


set_logger_level: Callable[..., None] = output.set_level
get_logger_effective_level = output.effective_level
get_logger_level = output.get_level
get_logging_severity_from_string = output.level_from_string
get_logging_directory = output.logging_directory
