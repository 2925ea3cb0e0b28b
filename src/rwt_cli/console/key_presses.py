"""Single key presses of a terminal, as events."""

from __future__ import annotations

import os
import sys
from collections.abc import AsyncGenerator, Iterator
from contextlib import contextmanager
from typing import Final, Literal

import anyio

Key = Literal["space", "up", "down", "right"]

_KEYS: Final[dict[bytes, Key]] = {
    b" ": "space",
    b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right",
    b"\x1bOA": "up", b"\x1bOB": "down", b"\x1bOC": "right",
}  # fmt: skip


async def key_presses() -> AsyncGenerator[Key, None]:
    """Keys as they are pressed. Without a terminal, or in the background, none ever are."""
    if not sys.stdin.isatty() or not hasattr(os, "tcgetpgrp"):
        return
    descriptor = sys.stdin.fileno()
    if os.tcgetpgrp(descriptor) != os.getpgrp():
        return  # Reading would stop a program in the background.
    with _without_lines(descriptor):
        while True:
            await anyio.wait_readable(descriptor)
            pressed = os.read(descriptor, 16)
            if not pressed:
                return
            key = _KEYS.get(pressed)
            if key is not None:
                yield key


@contextmanager
def _without_lines(descriptor: int) -> Iterator[None]:
    """Hand on each key at once and unseen; Ctrl-C stays what it is."""
    import termios  # not on every system
    import tty

    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor, termios.TCSADRAIN)  # Keys that were pressed already count.
    try:
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
