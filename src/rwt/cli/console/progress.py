"""Progress line of commands that take long."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Final

_TERMINAL_SECONDS: Final = 1.0
_PLAIN_SECONDS: Final = 10.0


class ProgressLine:
    """Progress on standard error: one line that is rewritten each second on a terminal, else a new line every
    ten seconds."""

    def __init__(self) -> None:
        self.is_terminal = sys.stderr.isatty()
        self._period = _TERMINAL_SECONDS if self.is_terminal else _PLAIN_SECONDS
        self._due = time.monotonic() + self._period
        self._width = 0

    def show(self, text: Callable[[], str]) -> None:
        """Print the text if it is due."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + self._period
        if not self.is_terminal:
            print(text(), file=sys.stderr, flush=True)
            return
        line = text()
        print(f"\r{line:{self._width}}", end="", file=sys.stderr, flush=True)
        self._width = len(line)

    def clear(self) -> None:
        """Erase the line from a terminal."""
        if self.is_terminal and self._width:
            print(f"\r{'':{self._width}}\r", end="", file=sys.stderr, flush=True)
            self._width = 0


def share(done: int, total: int) -> str:
    """Return a bar with the share that is done."""
    part = min(1.0, done / total) if total else 1.0
    filled = round(20 * part)
    return f"[{'#' * filled}{'.' * (20 - filled)}] {100 * part:3.0f} %"
