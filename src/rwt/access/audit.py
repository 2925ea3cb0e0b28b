"""Log of what clients do, and limits on the rate of its lines."""

from __future__ import annotations

import json
import logging
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rwt_transports.limits import RateLimit

logger: Final = logging.getLogger("rwt.bridge")

#: Maximum number of characters of a client's text in a log line.
_MAX_TEXT: Final = 500


class LogLosses:
    """Count of lines that the handlers of this process's log could not write.

    Attributes:
        lines: number of these lines.
        is_losing: True if the last line was one of them.
    """

    def __init__(self) -> None:
        self.lines = 0
        self.is_losing = False


LOG_LOSSES: Final = LogLosses()


class Audit:
    """Log of one server.

    Attributes:
        dropped_lines: number of lines that a handler refused with an error, for example for a full disk;
            those of :data:`LOG_LOSSES` are not included.
        rejections: rate of lines about rejected messages, over all clients. Ask it before a line is
            formatted: clients may cause as many as they send messages.
    """

    def __init__(self) -> None:
        self.dropped_lines = 0
        self.rejections = LineRate(per_second=5, burst=100)

    def write(
        self,
        level: int,
        text: str,
        *arguments: object,
        client: str | None = None,
        op_id: object = None,
        error: BaseException | None = None,
    ) -> None:
        """Write one line, with the fields `client` and `op_id` for formatters.

        `client` is the name that leases, requests for approval and the gate's audit log use, `rosbridge:3`.

        If writing fails, the line is dropped and counted.
        """
        if not is_written(level):
            return
        try:
            logger.log(
                level,
                text,
                *arguments,
                exc_info=error,
                extra={"client": client, "op_id": op_id},
                stacklevel=2,
            )
        except OSError:
            self.dropped_lines += 1


def is_written(level: int) -> bool:
    """Return True if lines of this level are logged."""
    return logger.isEnabledFor(level)


def one_line(text: str) -> str:
    """Return a client's text, truncated and without line breaks, so that it cannot forge log lines."""
    line = text if text.isprintable() else text.encode("unicode_escape").decode()
    return line if len(line) <= _MAX_TEXT else f"{line[:_MAX_TEXT]}…"


def visible_json(text: str) -> str:
    """Return JSON on one line with escapes for all characters that control a terminal or reverse text."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else json.dumps(each)[1:-1] for each in text)


class LineRate:
    """Rate limit of log lines: a burst, then a number of lines per second.

    Dropped lines are counted; the next line states their number, see :meth:`note`.

    Attributes:
        left_out: number of lines dropped since the last one that was written.

    Args:
        per_second: sustained rate.
        burst: maximum number of lines at once.
    """

    __slots__ = ("_rate", "left_out")

    def __init__(self, per_second: int, burst: int) -> None:
        self._rate = RateLimit(per_second, burst)
        self.left_out = 0

    def admit(self, now: float) -> bool:
        """Return True if a line may be written, which is formatted only then; False to drop it.

        Args:
            now: seconds of a steady clock.
        """
        if self._rate.take(now):
            return True
        self.left_out += 1
        return False

    def note(self) -> str:
        """Return the end of the next line, which states the number of dropped lines; empty without."""
        left_out, self.left_out = self.left_out, 0
        return f" ({left_out} lines like it were left out)" if left_out else ""


class LogRate(logging.Filter):
    """Log filter with a rate limit for each place in the code, over all clients.

    Args:
        per_second: sustained rate of lines from one place.
        burst: maximum number of lines from one place at once.
        monotonic: returns the seconds of a steady clock.
    """

    def __init__(
        self, per_second: int = 5, burst: int = 100, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__()
        self._monotonic = monotonic
        self._per_second = per_second
        self._burst = burst
        self._places: dict[tuple[str, int], LineRate] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return True to write a line; add the number of dropped lines before it."""
        place = record.pathname, record.lineno
        rate = self._places.get(place)
        if rate is None:
            rate = self._places[place] = LineRate(self._per_second, self._burst)
        if not rate.admit(self._monotonic()):
            return False
        left_out = rate.note()
        if left_out:
            record.msg, record.args = f"{record.getMessage()}{left_out}", ()
        return True


class PlainText(logging.Filter):
    """Log filter that escapes what controls a terminal; further lines of a text are indented.

    Parts of many texts come from clients, and must neither command the terminal nor look like other lines.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        """Return True; replace the text of a record that has such characters."""
        text = record.getMessage()
        if not text.isprintable():
            record.msg, record.args = "".join(map(_plain, text)), ()
        return True


def _plain(character: str) -> str:
    if character.isprintable():
        return character
    return "\n  " if character == "\n" else character.encode("unicode_escape").decode()


@contextmanager
def bounded_log() -> Iterator[None]:
    """Limit the rate of log lines of this project, asyncio and the MCP SDK within the block; escape them.

    Applies whatever the handlers are, and also to modules that are imported later. Loggers of the robot's own
    program are not affected.
    """
    filters = LogRate(), PlainText()
    _filters.extend(filters)
    _bind_new_loggers()
    for logger in _own_loggers():
        for each in filters:
            logger.addFilter(each)
    try:
        yield
    finally:
        for each in filters:
            _filters.remove(each)
            for logger in _own_loggers():
                logger.removeFilter(each)


_OWN: Final = re.compile(r"(?:rwt|rwt_\w+|asyncio|mcp)(?:\.|$)")
#: Filters of the blocks that are running.
_filters: Final[list[LogRate | PlainText]] = []


def _own_loggers() -> list[logging.Logger]:
    # A copy: other threads may import modules, which create loggers.
    loggers = logging.root.manager.loggerDict.copy().items()
    return [each for name, each in loggers if isinstance(each, logging.Logger) and _OWN.match(name)]


def _bind_new_loggers() -> None:
    """Apply the running filters to loggers that are created from now on."""
    kind = logging.getLoggerClass()
    if hasattr(kind, "applies_log_rates"):
        return

    def create(self: logging.Logger, name: str, level: int = logging.NOTSET) -> None:
        kind.__init__(self, name, level)
        if _OWN.match(name):
            for each in _filters:
                self.addFilter(each)

    logging.setLoggerClass(type(kind.__name__, (kind,), {"__init__": create, "applies_log_rates": True}))
