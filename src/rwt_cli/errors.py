"""What ends a command with one line on stderr instead of a traceback."""

from __future__ import annotations


class CommandError(Exception):
    """The command cannot go on; the text says what, where and what instead.

    Attributes:
        exit_code: 1 for what failed, 2 for what was asked wrongly.
    """

    def __init__(self, text: str, exit_code: int = 1) -> None:
        super().__init__(text)
        self.exit_code = exit_code
