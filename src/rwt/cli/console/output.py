"""Where a command prints: for people on a terminal, as plain text into a pipe, or as JSON for programs."""

from __future__ import annotations

import io
import json
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Final, Literal, TextIO

from rwt.cli.errors import INTERRUPTED, CommandError

Style = Literal["name", "type", "good", "warning", "bad", "faint", "heading"]

_CODES: Final[dict[Style, str]] = {
    "name": "36", "type": "32", "good": "32", "warning": "33", "bad": "31", "faint": "2", "heading": "1",
}  # fmt: skip
_UP_AND_CLEAR: Final = "\x1b[{}F\x1b[J"


_OWN_CODE: Final = "|".join(re.escape(f"\x1b[{code}m") for code in sorted({*_CODES.values(), "0"}))
_COMMANDS: Final = re.compile(
    f"({_OWN_CODE})|[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]"
)
"""What a terminal takes for a command, or turns the direction of a text by; a colour of this module first."""


class OutputClosed(Exception):
    """The reader of the output has closed the pipe."""


class OutputFailed(CommandError):
    """The output cannot be written, as to a file on a full disk."""


class Output:
    """Standard output.

    Attributes:
        people: whether people read it: a terminal, and JSON was not asked for.
        json: whether JSON was asked for.
    """

    def __init__(self, stream: TextIO, *, people: bool, colour: bool, json: bool) -> None:
        self.people = people
        self.json = json
        self._stream = stream
        self._colour = colour
        self._live_lines = 0

    def line(self, text: str = "") -> None:
        """Print one line; it is there for the reader at once.

        Raises:
            OutputClosed: the reader has closed the pipe.
            OutputFailed: it cannot be written.
        """
        self.text(f"{text}\n")

    def text(self, text: str) -> None:
        """Print some lines.

        Raises:
            OutputClosed: the reader has closed the pipe.
            OutputFailed: it cannot be written.
        """
        self._live_lines = 0
        # Whoever prints has replaced what a robot's names may hold; whoever forgot it does no harm.
        self._write(_COMMANDS.sub(_shown, text) if self.people else text)

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except BrokenPipeError:
            raise OutputClosed from None
        except OSError as error:
            raise OutputFailed(f"the output cannot be written: {error.strerror}") from None

    def record(self, value: object) -> None:
        """Print a value as one line of JSON, in which no character is a terminal's command."""
        text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(", ", ": "))
        self.line(_COMMANDS.sub(lambda found: f"\\u{ord(found[0]):04x}", text))

    def styled(self, text: str, style: Style) -> str:
        """`text` in a colour where there are colours; control characters are replaced on a terminal."""
        plain = self.escape_terminal(text)
        return f"\x1b[{_CODES[style]}m{plain}\x1b[0m" if self._colour and plain else plain

    def escape_terminal(self, text: str) -> str:
        """A text of the robot: unchanged for programs; on a terminal, control characters are replaced."""
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
        """Print lines for people in the place of those printed live before."""
        if self._live_lines:
            self._write(_UP_AND_CLEAR.format(self._live_lines))
        self.text("".join(f"{line}\n" for line in lines))
        self._live_lines = len(lines)


def standard_output(*, json: bool) -> Output:
    """The program's own output, as it is: see https://no-color.org for ``NO_COLOR``."""
    stream = sys.stdout
    if isinstance(stream, io.TextIOWrapper) and stream.encoding.lower() != "utf-8":
        # A name that the terminal cannot show must not raise.
        stream.reconfigure(errors="backslashreplace")
    people = stream.isatty() and not json
    colour = people and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    return Output(stream, people=people, colour=colour, json=json)


def _shown(found: re.Match[str]) -> str:
    return found[1] or "\N{REPLACEMENT CHARACTER}"


def printable(text: str) -> str:
    """`text` with each unprintable character replaced: names of a robot may hold terminal commands."""
    return (
        text
        if text.isprintable()
        else "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    )


def reported(act: Callable[[], object]) -> int:
    """Run a part of a command in a process of its own; the exit code, with why it failed on stderr."""
    try:
        act()
    except CommandError as error:
        print(failure_line(error), file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def failure_line(error: CommandError) -> str:
    """The line on stderr for an error: one line, whatever a robot's answer has in it."""
    return f"rwt: {printable(' '.join(str(error).splitlines()))}"


def note(text: str) -> None:
    """Print a line on standard error: something for people that is not the answer."""
    print(printable(text), file=sys.stderr, flush=True)


class NoteFormatter(logging.Formatter):
    """Lines of a log for people, in each of which a robot's text is no terminal's command."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """One line, whatever a robot's text has in it."""
        return printable(" ".join(super().formatMessage(record).splitlines()))


def log_notes(form: str) -> None:
    """Write warnings to standard error, in that format of :mod:`logging`."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(NoteFormatter(form))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
