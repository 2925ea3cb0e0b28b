"""What ends a command with one line on stderr instead of a traceback, and the exit codes."""

from __future__ import annotations

from typing import Final

FAILED: Final = 1
"""The command line was right, but the command did not succeed, or the robot refused."""
CALLED_WRONGLY: Final = 2
"""An unknown option, a name or a message that cannot be read or does not fit its type."""
CANNOT_CONNECT: Final = 3
"""There is no connection to the robot, or it was lost."""
TIMED_OUT: Final = 4
"""Nothing came in time."""
INTERRUPTED: Final = 130
"""Ctrl-C ended a command that ends by itself; as in shells, 128 + SIGINT."""
PIPE_CLOSED: Final = 141
"""The reader of the output has closed the pipe; as in shells, 128 + SIGPIPE."""


class CommandError(Exception):
    """The command cannot go on; the text says what, where and what instead.

    Attributes:
        exit_code: one of the constants of this module.
    """

    def __init__(self, text: str, exit_code: int = FAILED) -> None:
        super().__init__(text)
        self.exit_code = exit_code
