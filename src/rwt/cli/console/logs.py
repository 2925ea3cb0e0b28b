"""Log of `rwt serve` on stderr: text lines, one JSON object per line, or logfmt."""

from __future__ import annotations

import argparse
import json
import logging
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Final, Literal, TextIO

from rwt.access.audit import LOG_LOSSES, visible_json

Format = Literal["text", "json", "logfmt"]

FORMATS: Final[tuple[Format, ...]] = ("text", "json", "logfmt")

_TEXT: Final = "%(asctime)s %(levelname)s %(name)s %(message)s"
_PLAIN: Final = re.compile(r"[^\s\"=\\\x00-\x1f\x7f]+")
_FIELDS: Final = ("client", "op_id")


class TextFormatter(logging.Formatter):
    """Formatter of text lines: a record is one line, besides its traceback, without commands for a terminal.

    Second line of defence: callers already escape the text of clients.
    """

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Return a record with unprintable characters escaped."""
        return visible_json(super().formatMessage(record))


class JsonFormatter(logging.Formatter):
    """Formatter of JSON lines: `time` (UTC, RFC 3339), `level`, `logger`, `message`, and if present `worker`
    (with `--workers`), `client` (its name, `rosbridge:3`), `op_id` and `error` (the traceback).

    Attributes:
        worker: number of the worker process; None without workers.
    """

    worker: int | None = None

    def format(self, record: logging.LogRecord) -> str:
        """Return the JSON object of a record."""
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if self.worker is not None:
            line["worker"] = self.worker
        for field in _FIELDS:
            value = getattr(record, field, None)
            if value is not None:
                line[field] = value
        if record.exc_info:
            line["error"] = self.formatException(record.exc_info)
        return self._written(line)

    def _written(self, line: Mapping[str, object]) -> str:
        return visible_json(json.dumps(line, default=str, ensure_ascii=False))


class LogfmtFormatter(JsonFormatter):
    """Formatter of logfmt lines, `key=value`, with the fields of :class:`JsonFormatter`."""

    def _written(self, line: Mapping[str, object]) -> str:
        return " ".join(f"{key}={_word(str(value))}" for key, value in line.items())


def _word(text: str) -> str:
    """Return a value of logfmt, quoted as in JSON unless it is one plain word."""
    if _PLAIN.fullmatch(text) and text.isprintable():
        return text
    return visible_json(json.dumps(text, ensure_ascii=False))


class SteadyHandler(logging.StreamHandler[TextIO]):
    """Handler for a stream that may fail: resumes with the next line once the disk has space again.

    Attributes:
        lost: number of lines that could not be written; reported before the next line.
    """

    def __init__(self, stream: TextIO) -> None:
        super().__init__(stream)
        self.lost = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        try:
            line = self.format(record)
            if self.lost:
                note = logging.LogRecord(
                    __name__, logging.WARNING, "", 0, "%d lines of the log were lost", (self.lost,), None
                )
                line = f"{self.format(note)}\n{line}"
            self.stream.write(f"{line}\n")
            self.flush()
        except OSError:
            self.lost += 1
            LOG_LOSSES.lines += 1
            LOG_LOSSES.is_losing = True
        except Exception:
            # A record that cannot be formatted is a bug of the caller: report it as logging does.
            self.handleError(record)
        else:
            self.lost = 0
            LOG_LOSSES.is_losing = False


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of :func:`log_to_stderr`."""
    parser.add_argument("--verbose", "-v", action="store_true", help="log more")
    parser.add_argument(
        "--log-format",
        choices=FORMATS,
        help="text lines, one JSON object per line, or logfmt (default text)",
    )


def log_to_stderr(style: Format | None, *, verbose: bool, level: str = "info") -> None:
    """Log to stderr in this format (default text), from this level, or debug if `verbose`."""
    handler = SteadyHandler(sys.stderr)
    made = {"json": JsonFormatter(), "logfmt": LogfmtFormatter(), "text": TextFormatter(_TEXT)}
    handler.setFormatter(made[style or "text"])
    root = logging.getLogger()
    root.addHandler(handler)
    root.setLevel("DEBUG" if verbose else level.upper())


@contextmanager
def quiet(logger: str, level: int) -> Iterator[None]:
    """Suppress within the block what a logger has to say below this level."""
    log = logging.getLogger(logger)
    before = log.level
    log.setLevel(level)
    try:
        yield
    finally:
        log.setLevel(before)


def name_worker(number: int) -> None:
    """Prefix all log lines of this worker process with its number."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler.formatter, JsonFormatter):
            handler.formatter.worker = number
        elif isinstance(handler, SteadyHandler):
            handler.setFormatter(TextFormatter(f"[{number}] {_TEXT}"))
