"""Signals that end a program or ask it to read its files again, with what every system has.

Event loops have signal handlers of their own on some systems only; :func:`signal.signal` is everywhere.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from rwt_graph.memory.runtime import call_soon_threadsafe

if TYPE_CHECKING:
    from types import FrameType

STOP_SIGNALS: Final = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name)
)
"""What asks a program to end: Ctrl-C, a supervisor such as systemd, and Ctrl-Break on Windows."""

HANGUP: Final[int | None] = getattr(signal, "SIGHUP", None)
"""What asks a server to read its files again; None where there is no such signal."""


class Stopped(SystemExit):
    """A signal has asked a program without an event loop to end; its exit code is 0."""

    def __init__(self) -> None:
        super().__init__(0)


@contextmanager
def on_signals(handlers: Mapping[int, Callable[[], object]]) -> Iterator[None]:
    """Call plain functions on the running event loop when signals come, within the block.

    A signal to end is taken once: the same again does what it did before the block, so that a second Ctrl-C
    ends what hangs. Outside of the program's main thread, which alone gets signals, nothing is called.

    Args:
        handlers: a function for each signal.
    """
    call_soon = call_soon_threadsafe()

    def handle(number: int, frame: FrameType | None) -> None:
        if number in STOP_SIGNALS:
            signal.signal(number, before[number])
        call_soon(handlers[number])

    with _handled(dict.fromkeys(handlers, handle)) as before:
        yield


@contextmanager
def stopped_by_signals(on_hangup: Callable[[], object]) -> Iterator[None]:
    """Raise :exc:`Stopped` in a program without an event loop when SIGTERM comes, within the block.

    Without it the program would end at once, and neither ``finally`` nor ``with`` would run. A program that
    handles a signal itself goes on doing so. Ctrl-C raises :exc:`KeyboardInterrupt`, as it always does.

    Args:
        on_hangup: called when SIGHUP comes, between two steps of the main thread.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)  # A second one must not interrupt the clean-up.
        raise Stopped

    def hang_up(number: int, frame: FrameType | None) -> None:
        if terminal_is_gone():
            stop(number, frame)
        on_hangup()

    wanted = {signal.SIGTERM: stop, **({} if HANGUP is None else {HANGUP: hang_up})}
    free = {
        number: handler for number, handler in wanted.items() if signal.getsignal(number) is signal.SIG_DFL
    }
    with _handled(free):
        yield


_Handler = Callable[[int, "FrameType | None"], None]


@contextmanager
def _handled(handlers: Mapping[int, _Handler]) -> Iterator[dict[int, _Handler | int | None]]:
    """Install handlers within the block, in the main thread; gives those from before it."""
    if threading.current_thread() is not threading.main_thread():
        yield {}
        return
    before: dict[int, _Handler | int | None] = {}
    try:
        for number, handler in handlers.items():
            before[number] = signal.getsignal(number)
            signal.signal(number, handler)
        yield before
    finally:
        for number, handler_before in before.items():
            signal.signal(number, signal.SIG_DFL if handler_before is None else handler_before)


_STARTED_IN_TERMINAL: Final = sys.stderr is not None and os.isatty(2)


def terminal_is_gone() -> bool:
    """Whether this program was started in a terminal that has been closed since: SIGHUP then says so."""
    return _STARTED_IN_TERMINAL and not os.isatty(2)
