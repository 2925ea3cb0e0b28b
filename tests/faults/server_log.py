"""Log of internal failures of a server in this process."""

from __future__ import annotations

import logging
from typing import Self


class Failures(logging.Handler):
    """Keeps every line of the log, within a block, that tells of a failure of the server's own: errors, and
    whatever comes with a traceback."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self._lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the line of a failure."""
        if record.levelno >= logging.ERROR or record.exc_info:
            self._lines.append(logging.Formatter().format(record))

    def __enter__(self) -> Self:
        logging.getLogger().addHandler(self)
        return self

    def __exit__(self, *exception: object) -> None:
        logging.getLogger().removeHandler(self)

    def check(self) -> None:
        """Fails where there was one."""
        assert not self._lines, "\n".join(self._lines)
