"""Key presses of a terminal as events."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import AsyncGenerator, Iterator
from contextlib import contextmanager, suppress
from typing import Final, Literal

import anyio

Key = Literal["space", "up", "down", "right", "left", "q"]

_KEYS: Final[dict[bytes, Key]] = {
    b" ": "space", b"q": "q",
    b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left",
    b"\x1bOA": "up", b"\x1bOB": "down", b"\x1bOC": "right", b"\x1bOD": "left",
}  # fmt: skip
_PRESS: Final = re.compile(rb"\x1b[\[O][A-D]|.", re.DOTALL)


def can_press_keys() -> bool:
    """True if keys can be read: standard input is a terminal with this program in its foreground; reading in
    the background would stop the program."""
    if not sys.stdin.isatty() or not hasattr(os, "tcgetpgrp"):
        return False
    return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()


async def key_presses() -> AsyncGenerator[Key, None]:
    """Yield key presses and the terminal's repetitions of held keys; nothing without a terminal."""
    if not can_press_keys():
        return
    descriptor = sys.stdin.fileno()
    with _without_lines(descriptor):
        while True:
            await anyio.wait_readable(descriptor)
            try:
                arrived = os.read(descriptor, 64)
            except OSError:  # The terminal was closed.
                return
            if not arrived:
                return
            for pressed in _PRESS.findall(arrived):
                key = _KEYS.get(pressed)
                if key is not None:
                    yield key


@contextmanager
def _without_lines(descriptor: int) -> Iterator[None]:
    """Read keys without line buffering and echo; Ctrl-C still interrupts."""
    import termios  # not on every system
    import tty

    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor, termios.TCSADRAIN)  # Keep keys that were pressed already.
    try:
        yield
    finally:
        with suppress(termios.error):  # The terminal may have been closed.
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
