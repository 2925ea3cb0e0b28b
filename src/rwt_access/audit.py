"""The bridge's log: every line says which client and which op it is about, as text and as fields."""

from __future__ import annotations

import logging
from typing import Final

logger: Final = logging.getLogger("rwt.bridge")

#: Characters of one line of the log that a client has a say in.
_LONGEST_LINE: Final = 500


class LostLines:
    """How many lines a log could not take since the process began."""

    count = 0


def write(
    level: int,
    text: str,
    *arguments: object,
    client: int | None = None,
    op_id: object = None,
    error: BaseException | None = None,
) -> None:
    """One line, with the fields `client` and `op_id` for whoever formats it.

    A log that cannot be written, because its disk is full, costs the line and never the server.
    """
    if not is_written(level):
        return
    try:
        logger.log(
            level, text, *arguments, exc_info=error, extra={"client": client, "op_id": op_id}, stacklevel=2
        )
    except OSError:
        LostLines.count += 1


def is_written(level: int) -> bool:
    """Whether lines of this level go anywhere."""
    return logger.isEnabledFor(level)


def one_line(text: str) -> str:
    """A text of the client's own making, cut and without line breaks, so that it cannot forge log lines."""
    line = text if text.isprintable() else text.encode("unicode_escape").decode()
    return line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}…"
