"""Signal handlers that stop a program or reload its files, on every system.

Uses :func:`signal.signal`, because event loops have signal handlers only on some systems.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
from typing import Final

from rwt_participant.threads.pool import call_soon_threadsafe

STOP_SIGNALS: Final = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name)
)
"""Signals that stop a program: Ctrl-C, a supervisor such as systemd, and Ctrl-Break on Windows."""

HANGUP: Final[int | None] = getattr(signal, "SIGHUP", None)
"""Signal that reloads the files; None on systems without it."""


class Stopped(SystemExit):
    """A signal has stopped a program without an event loop; its exit code is 0."""

    def __init__(self) -> None:
        super().__init__(0)


@contextmanager
def on_signals(handlers: Mapping[int, Callable[[], object]]) -> Iterator[None]:
    """Call plain functions on the running event loop when signals arrive, within the block.

    Ctrl-C is handled once: a second one has its previous effect, so that it ends a program that hangs. A
    second SIGTERM changes nothing: GNU's ``timeout`` sends it twice, and supervisors send SIGKILL to what
    hangs. No-op outside the main thread, the only one that receives signals.
    """
    call_soon = call_soon_threadsafe()

    def handle(number: int, frame: FrameType | None) -> None:
        if number in STOP_SIGNALS and number != signal.SIGTERM:
            signal.signal(number, before[number])
        call_soon(handlers[number])

    with _handled(dict.fromkeys(handlers, handle)) as before:
        yield


@contextmanager
def stopped_by_signals(on_hangup: Callable[[], object]) -> Iterator[None]:
    """Raise :exc:`Stopped` on SIGTERM within the block, in a program without an event loop.

    The exception runs ``finally`` and ``with`` before the program ends. Signals that the program handles
    itself are left alone. Ctrl-C raises :exc:`KeyboardInterrupt` as usual.

    Args:
        on_hangup: called on SIGHUP, in the main thread.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)  # A second signal must not interrupt the clean-up.
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
    """Install handlers within the block, in the main thread; yield the previous ones."""
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
    """True if this program's terminal has been closed since the start, which also causes SIGHUP."""
    return _STARTED_IN_TERMINAL and not os.isatty(2)
