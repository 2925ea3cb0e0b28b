"""Output of a command: for people on a terminal, plain text into a pipe, or JSON for programs."""

from __future__ import annotations

import io
import json
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, Literal, TextIO

from rwt.cli.errors import FAILED, INTERRUPTED, CommandError

Style = Literal["name", "type", "good", "warning", "bad", "faint", "heading"]

_CODES: Final[dict[Style, str]] = {
    "name": "36", "type": "32", "good": "32", "warning": "33", "bad": "31", "faint": "2", "heading": "1",
}  # fmt: skip
#: Maximum length of an error line.
_ERROR_CHARS: Final = 2000

_UP_AND_CLEAR: Final = "\x1b[{}F\x1b[J"


_OWN_CODE: Final = "|".join(re.escape(f"\x1b[{code}m") for code in sorted({*_CODES.values(), "0"}))
_CONTROLS: Final = r"\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff"
_COMMANDS: Final = re.compile(f"({_OWN_CODE})|[{_CONTROLS}]")
"""Control characters of terminals and text direction, invisible ones; colours of this module match first."""


class OutputClosed(Exception):
    """The reader of the output has closed the pipe."""


class OutputFailed(CommandError):
    """The output cannot be written, as to a file on a full disk."""


class Output:
    """Standard output.

    Attributes:
        people: True if the output is a terminal and not JSON.
    """

    def __init__(self, stream: TextIO, *, people: bool, colour: bool, json: bool) -> None:
        self.people = people
        self.json = json
        self._stream = stream
        self._colour = colour
        self._live_lines = 0

    def line(self, text: str = "") -> None:
        """Print one line, and flush."""
        self.text(f"{text}\n")

    def lines(self, lines: Iterable[str]) -> None:
        """Print lines at once, and flush."""
        self.text("".join(f"{line}\n" for line in lines))

    def text(self, text: str) -> None:
        """Print lines, and flush.


        Raises:
            OutputClosed: the reader has closed the pipe.
            OutputFailed: the lines cannot be written.
        """
        self._live_lines = 0
        # Second line of defence: callers already escape names of the robot.
        shown = _COMMANDS.sub(lambda found: found[1] or "\N{REPLACEMENT CHARACTER}", text)
        self._write(shown if self.people else text)

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except BrokenPipeError:
            raise OutputClosed from None
        except OSError as error:
            raise OutputFailed(f"the output cannot be written: {error.strerror}") from None

    def record(self, value: object) -> None:
        """Print a value as one line of JSON with control characters escaped."""
        text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(", ", ": "))
        self.line(_COMMANDS.sub(lambda found: f"\\u{ord(found[0]):04x}", text))

    def answer(self, value: object, text: str) -> None:
        """Print a value as JSON, or what it says as a line."""
        if self.json:
            self.record(value)
        else:
            self.line(text)

    def names(self, names: Iterable[str], style: Style) -> None:
        """Print names, one on each line, or a list of them as JSON."""
        if self.json:
            self.record([*names])
        else:
            for name in names:
                self.line(self.styled(name, style))

    def styled(self, text: str, style: Style) -> str:
        """Return `text` coloured if colours are on; on a terminal, with control characters replaced."""
        plain = self.escape_terminal(text)
        return f"\x1b[{_CODES[style]}m{plain}\x1b[0m" if self._colour and plain else plain

    def escape_terminal(self, text: str) -> str:
        """Return a text of the robot, on a terminal with control characters replaced."""
        return printable(text) if self.people else text

    def columns(self, rows: Iterable[Sequence[str]], styles: Sequence[Style | None]) -> None:
        """Print rows in aligned columns, each in its style."""
        table = [tuple(map(printable, row)) for row in rows]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        for row in table:
            cells = (
                self._cell(text, width if last is not None else 0, style)
                for text, width, style, last in zip(row, widths, styles, [*row[1:], None], strict=True)
            )
            self.line("  ".join(cells).rstrip())

    def _cell(self, text: str, width: int, style: Style | None) -> str:
        padding = " " * (width - len(text))
        return f"{text if style is None else self.styled(text, style)}{padding}"

    def live(self, lines: Sequence[str]) -> None:
        """Print lines over those that the last call printed."""
        if self._live_lines:
            self._write(_UP_AND_CLEAR.format(self._live_lines))
        self.lines(lines)
        self._live_lines = len(lines)

    def report(self, lines: Sequence[str], *more: str) -> None:
        """Print lines that are updated in place on a terminal; elsewhere, with further ones below them."""
        if self.people:
            self.live(lines)
        else:
            self.lines([*lines, *more])


def standard_output(*, json: bool) -> Output:
    """Return the output to stdout, in colour on a terminal unless ``NO_COLOR`` is set (https://no-color.org)."""
    stream = sys.stdout
    if isinstance(stream, io.TextIOWrapper) and stream.encoding.lower() != "utf-8":
        # Names that the terminal cannot encode must not raise.
        stream.reconfigure(errors="backslashreplace")
    people = stream.isatty() and not json
    colour = people and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    return Output(stream, people=people, colour=colour, json=json)


def printable(text: str) -> str:
    """Return `text` with unprintable characters replaced: names of a robot may contain terminal commands."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def reported(act: Callable[[], object]) -> int:
    """Run a part of a command in its own process: print its error on stderr, and return the exit code."""
    try:
        act()
    except CommandError as error:
        print(failure_line(error), file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def failure_line(error: CommandError) -> str:
    """Return the line on stderr for an error, with line breaks and control characters replaced.

    A robot may have sent a part of the text, of any length: it is cut.
    """
    text = " ".join(str(error).splitlines())
    return f"rwt: {printable(text if len(text) <= _ERROR_CHARS else f'{text[:_ERROR_CHARS]}…')}"


def write_file(path: Path, text: str) -> None:
    """Write a text file.

    Raises:
        CommandError: the file cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror}", FAILED) from error


def note(text: str) -> None:
    """Print a line on standard error, for people and not part of the output."""
    print(printable(text), file=sys.stderr, flush=True)


class NoteFormatter(logging.Formatter):
    """Formatter of log lines for people, with control characters replaced."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Return the record as one line."""
        return printable(" ".join(super().formatMessage(record).splitlines()))


def log_notes(form: str) -> None:
    """Log warnings to standard error, in this format of :mod:`logging`."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(NoteFormatter(form))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
