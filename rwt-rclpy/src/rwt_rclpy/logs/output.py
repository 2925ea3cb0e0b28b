"""Levels of loggers, and output of lines: the console in rcutils' format, and `/rosout`."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

from rwt_rclpy.clocks import timekeeper

if TYPE_CHECKING:
    from rwt_rclpy.names.arguments import RosArguments

SEPARATOR: Final = "."


class LoggingSeverity(IntEnum):
    """`rclpy.logging.LoggingSeverity`."""

    UNSET = 0
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50


@dataclass(frozen=True, slots=True)
class LogLine:
    """Log line.

    Attributes:
        stamp_ns: system time.
        name: name of the logger.
        message: text.
        function: function of the call site.
        file: file of the call site.
        line: line of the call site.
    """

    severity: LoggingSeverity
    stamp_ns: int
    name: str
    message: str
    function: str
    file: str
    line: int


OnLine = Callable[[LogLine], None]

_lock = threading.RLock()
_levels: dict[str, int] = {}
_FORMAT: Final = "[{severity}] [{time}] [{name}]: {message}"
_COLOURS: Final = {10: "\x1b[32m", 30: "\x1b[33m", 40: "\x1b[31m", 50: "\x1b[31m"}
#: Functions that publish lines on `/rosout`, by logger of a node.
_rosout: dict[str, list[OnLine]] = {}


class _Enabled:
    stdout = True
    rosout = True


_enabled = _Enabled()


def configure(arguments: RosArguments) -> None:
    """Apply the levels and switches of a command line."""
    for name, level in arguments.log_levels.items():
        set_level(name, level)
    _enabled.stdout = arguments.stdout
    _enabled.rosout = arguments.rosout


def set_level(name: str, level: int, detailed_error: bool = False) -> None:
    """Set the level of a logger, and of those below it without their own."""
    level = LoggingSeverity(level)
    with _lock:
        if level is LoggingSeverity.UNSET and name:
            _levels.pop(name, None)
        else:
            _levels[name] = int(level) if level or not name else int(LoggingSeverity.INFO)


def get_level(name: str) -> LoggingSeverity:
    """Return the level of the logger itself, or UNSET."""
    return LoggingSeverity(_levels.get(name, 0 if name else LoggingSeverity.INFO))


def effective_level(name: str) -> LoggingSeverity:
    """Return the effective level of a logger: its own, or that of the nearest one above."""
    while name:
        level = _levels.get(name)
        if level is not None:
            return LoggingSeverity(level)
        name = name.rpartition(SEPARATOR)[0]
    return LoggingSeverity(_levels.get("", LoggingSeverity.INFO))


def clear_levels() -> None:
    """Reset all levels."""
    with _lock:
        _levels.clear()


def level_from_string(text: str) -> LoggingSeverity:
    """Return the level of a name, in either case. Raises RuntimeError for unknown ones."""
    try:
        return LoggingSeverity[text.upper()]
    except KeyError:
        raise RuntimeError(
            f"{text!r} is not a severity: expected {[s.name for s in LoggingSeverity]}"
        ) from None


def logging_directory() -> Path:
    """Return ROS's log folder: ROS_LOG_DIR, ROS_HOME/log, or ~/.ros/log. Nothing is written there."""
    if os.environ.get("ROS_LOG_DIR"):
        return Path(os.environ["ROS_LOG_DIR"]).expanduser()
    return Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "log"


def add_rosout(name: str, on_line: OnLine) -> None:
    """Pass the lines of a logger, and of those below it, to `on_line`, too."""
    with _lock:
        taken = _rosout.setdefault(name, [])
        taken.append(on_line)
    if len(taken) > 1:
        message = (
            f"Publisher already registered for node name: '{name}'. If this is due to multiple nodes with the"
            f" same name then all logs for the logger named '{name}' will go out over the existing publisher."
            " As soon as any node with that name is destructed it will unregister the publisher, preventing"
            " any further logs for that name from being published on the rosout topic."
        )
        write(LoggingSeverity.WARN, "rcl.logging_rosout", message, "add_rosout", __file__, 0)


def remove_rosout(name: str, on_line: OnLine) -> None:
    """Undo :func:`add_rosout`."""
    with _lock:
        taken = _rosout.get(name, [])
        if on_line in taken:
            taken.remove(on_line)
        if not taken:
            _rosout.pop(name, None)


def write(severity: LoggingSeverity, name: str, message: str, function: str, file: str, line: int) -> None:
    """Print a line, and publish it."""
    entry = LogLine(severity, timekeeper.current().system_ns(), name, message, function, file, line)
    if _enabled.stdout:
        stream = sys.stdout if os.environ.get("RCUTILS_LOGGING_USE_STDOUT") == "1" else sys.stderr
        print(formatted(entry, stream), file=stream, flush=True)
    if _enabled.rosout and _rosout:
        _to_rosout(entry)


def _to_rosout(entry: LogLine) -> None:
    name = entry.name
    while name:
        taken = _rosout.get(name)
        if taken:
            # Nodes of one name share a logger; the newest publishes.
            taken[-1](entry)
            return
        name = name.rpartition(SEPARATOR)[0]


def formatted(entry: LogLine, stream: TextIO) -> str:
    """Format a line by RCUTILS_CONSOLE_OUTPUT_FORMAT, in colour on a terminal."""
    text = os.environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or _FORMAT
    values = {
        "severity": entry.severity.name,
        "time": f"{entry.stamp_ns // 10**9}.{entry.stamp_ns % 10**9:09d}",
        "time_as_nanoseconds": str(entry.stamp_ns),
        "date_time_with_ms": time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(entry.stamp_ns / 1e9)),
        "name": entry.name,
        "message": entry.message,
        "function_name": entry.function,
        "file_name": entry.file,
        "line_number": str(entry.line),
    }
    for key, value in values.items():
        text = text.replace("{" + key + "}", value)
    wanted = os.environ.get("RCUTILS_COLORIZED_OUTPUT")
    coloured = wanted == "1" or (wanted != "0" and stream.isatty())
    colour = _COLOURS.get(int(entry.severity), "")
    return f"{colour}{text}\x1b[0m" if coloured and colour else text
