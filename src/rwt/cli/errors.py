"""Exit codes, and the error that ends a command with one line on stderr."""

from __future__ import annotations

from typing import Final

FAILED: Final = 1
"""The command was valid but failed, or the robot rejected it."""
CALLED_WRONGLY: Final = 2
"""Incorrect use: an unknown option, or a name or message that is invalid or does not match its type."""
CANNOT_CONNECT: Final = 3
"""The connection to the robot failed or was lost."""
TIMED_OUT: Final = 4
"""Timeout."""
INTERRUPTED: Final = 130
"""Ctrl-C interrupted a command that ends by itself; 128 + SIGINT, as in shells."""
PIPE_CLOSED: Final = 141
"""The reader of the output has closed the pipe; 128 + SIGPIPE, as in shells."""


class CommandError(Exception):
    """Failure of a command; the text says what failed, where, and what to do.

    Attributes:
        exit_code: one of the constants of this module.
    """

    def __init__(self, text: str, exit_code: int = FAILED) -> None:
        super().__init__(text)
        self.exit_code = exit_code


def cannot_read(what: object, error: OSError) -> CommandError:
    """Return the error for a file that an argument names."""
    return CommandError(f"{what}: cannot be read: {error.strerror}", CALLED_WRONGLY)
