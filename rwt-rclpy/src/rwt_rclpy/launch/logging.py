"""`launch.logging`: output of a launch and its processes, line by line on standard output."""

from __future__ import annotations

import logging
import sys

_ROOT = "launch"


class _ToStandardOutput(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        name = record.name.removeprefix(f"{_ROOT}.")
        show(f"[{record.levelname}] [{name}]: {record.getMessage()}")


def show(line: str) -> None:
    """Print a line to the current standard output, and flush."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def get_logger(name: str | None = None) -> logging.Logger:
    """Return the logger of a part of a launch; by default `launch`."""
    root = logging.getLogger(_ROOT)
    if not any(isinstance(each, _ToStandardOutput) for each in root.handlers):
        root.addHandler(_ToStandardOutput())
        root.setLevel(logging.INFO)
        root.propagate = False
    return root if name in (None, _ROOT) else root.getChild(str(name))
