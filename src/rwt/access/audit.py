"""The log of what clients do: each line names the client and the op it is about, as text and as fields."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rwt.access.quotas import RateLimit

logger: Final = logging.getLogger("rwt.bridge")

#: Characters of one line of the log that a client has a say in.
_LONGEST_LINE: Final = 500


class Audit:
    """The log of one server.

    Attributes:
        dropped_lines: lines that the log could not take, as when its disk is full.
    """

    def __init__(self) -> None:
        self.dropped_lines = 0

    def write(
        self,
        level: int,
        text: str,
        *arguments: object,
        client: int | None = None,
        op_id: object = None,
        error: BaseException | None = None,
    ) -> None:
        """One line, with the fields `client` and `op_id` for formatters.

        A log that cannot be written costs the line and never the server.
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
    """Whether lines of this level go anywhere."""
    return logger.isEnabledFor(level)


def one_line(text: str) -> str:
    """A text of the client's own making, cut and without line breaks, so that it cannot forge log lines."""
    line = text if text.isprintable() else text.encode("unicode_escape").decode()
    return line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}…"


class LineRate:
    """How many lines of the log a client may cause: a burst, then so many a second.

    Those beyond the rate are counted, and mentioned in the next line.

    Attributes:
        left_out: lines left out since the last one that was written.

    Args:
        per_second: lines in the long run.
        burst: lines at once.
    """

    __slots__ = ("_rate", "left_out")

    def __init__(self, per_second: int, burst: int) -> None:
        self._rate = RateLimit(per_second, burst)
        self.left_out = 0

    def admit(self, text: str, now: float) -> str | None:
        """The line to write in place of `text`, or None to leave it out.

        Args:
            text: the line.
            now: seconds on a clock that never goes back.
        """
        if not self._rate.take(now):
            self.left_out += 1
            return None
        left_out, self.left_out = self.left_out, 0
        return f"{text} ({left_out} lines like it were left out)" if left_out else text


class LogRate(logging.Filter):
    """Bounds how many lines each place in the program writes, whichever client causes them.

    Args:
        per_second: lines of one place in the long run.
        burst: lines of one place at once.
        monotonic: seconds on a clock that never goes back.
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
        """Whether the line is written; one that follows others that were not says how many they were."""
        place = record.pathname, record.lineno
        rate = self._places.get(place)
        if rate is None:
            rate = self._places[place] = LineRate(self._per_second, self._burst)
        left_out = rate.left_out
        if rate.admit("", self._monotonic()) is None:
            return False
        if left_out:
            record.msg = f"{record.getMessage()} ({left_out} lines like it were left out)"
            record.args = ()
        return True


@contextmanager
def bounded_log() -> Iterator[None]:
    """Bound within the block how many lines each place of this project, of asyncio and of the SDK for agents
    writes, whichever handlers a program has for them.

    The loggers are those that there are when the block begins. The lines of a robot's own program, whose
    loggers have names of their own, are not touched.
    """
    rate = LogRate()
    loggers = [
        logger
        # A copy, since other threads may import modules, which have loggers of their own.
        for name, logger in logging.root.manager.loggerDict.copy().items()
        if isinstance(logger, logging.Logger) and _OWN.match(name)
    ]
    for logger in loggers:
        logger.addFilter(rate)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeFilter(rate)


_OWN: Final = re.compile(r"(?:rwt|rwt_\w+|asyncio|mcp)(?:\.|$)")
