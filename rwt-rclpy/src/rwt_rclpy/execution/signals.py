"""`rclpy.signals`: Ctrl-C and SIGTERM, as ROS 2 answers them.

Either ends every context. Ctrl-C raises KeyboardInterrupt in the main thread besides, since the handler that
was there before is called; after SIGTERM what spins raises ExternalShutdownException. An executor that waits
is woken by the end of its context, and raises KeyboardInterrupt when it holds nothing.
"""

from __future__ import annotations

import signal
import threading
from enum import Enum, IntFlag
from functools import partial
from queue import SimpleQueue
from types import FrameType
from typing import Any

from rwt_rclpy.execution.context import Context, initialised_contexts
from rwt_rclpy.execution.guard_condition import GuardCondition
from rwt_rclpy.execution.interruption import UNINTERRUPTED


class SignalHandlerOptions(IntFlag):
    """Signals that shut contexts down."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3

    __str__ = Enum.__str__


_OPTIONS = {signal.SIGINT: SignalHandlerOptions.SIGINT, signal.SIGTERM: SignalHandlerOptions.SIGTERM}
_before: dict[signal.Signals, Any] = {}
#: Signals that have come; its `put` may be called in a handler, whatever the interrupted code holds.
_received: SimpleQueue[int] = SimpleQueue()
_watcher: threading.Thread | None = None


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Answer signals from now on; in threads other than the main one, which cannot, it does nothing."""
    global _watcher
    if threading.current_thread() is not threading.main_thread():
        return
    if options and (_watcher is None or not _watcher.is_alive()):
        _watcher = threading.Thread(target=_end_contexts, name="signals", daemon=True)
        _watcher.start()
    for number, option in _OPTIONS.items():
        if option & options and number not in _before:
            _before[number] = signal.signal(number, _handle)


def uninstall_signal_handlers() -> None:
    """Give the signals back to who had them."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in tuple(_before):
        signal.signal(number, _before.pop(number))


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    """Return the signals that are handled now."""
    options = SignalHandlerOptions.NO
    for number in _before:
        options |= _OPTIONS[number]
    return options


def _handle(number: int, frame: FrameType | None) -> None:
    # In another thread: the main thread may hold a lock that ending a context needs, or starting a thread.
    _received.put(number)
    before = _before.get(signal.Signals(number))
    if callable(before):
        UNINTERRUPTED.interrupt(partial(before, number, frame))


def _end_contexts() -> None:
    while True:
        _received.get()
        for context in initialised_contexts():
            context._rwt_shutdown_by_signal()


class SignalHandlerGuardCondition(GuardCondition):
    """A guard condition by rclpy's name; executors here are woken by the context itself."""

    def __init__(self, context: Context | None = None) -> None:
        super().__init__(None, None, context)
