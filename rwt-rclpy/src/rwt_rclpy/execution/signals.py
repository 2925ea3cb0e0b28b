"""`rclpy.signals`: handling of Ctrl-C and SIGTERM as in ROS 2.

Either ends every context. Ctrl-C also raises KeyboardInterrupt in the main thread, because the previous
handler is called; after SIGTERM, spinning functions raise ExternalShutdownException. A waiting executor
is woken by the end of its context, and raises KeyboardInterrupt when it holds no lock.
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
#: Received signals; `put` may be called in a handler, whatever locks the interrupted code holds.
_received: SimpleQueue[int] = SimpleQueue()
_watcher: threading.Thread | None = None


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Install the signal handlers; no-op in threads other than the main one."""
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
    """Restore the previous signal handlers."""
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
    # In another thread: the main thread may hold a lock that ending a context needs.
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
    """Guard condition under rclpy's name; executors here are woken by the context itself."""

    def __init__(self, context: Context | None = None) -> None:
        super().__init__(None, None, context)
