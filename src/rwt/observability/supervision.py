"""Notifications to a service manager such as systemd: ready, alive, reloading, stopping (sd_notify(3))."""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable
from typing import Final

from rwt_graph.clock import Clock
from rwt_participant.timers import Timer

logger = logging.getLogger(__name__)

READY: Final = "READY=1"
STOPPING: Final = "STOPPING=1"
ALIVE: Final = "WATCHDOG=1"


def tell(state: str) -> None:
    """Notify the service manager of lines ``NAME=VALUE``; no-op if it did not start this process."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return
    if address.startswith("@"):  # Abstract socket names begin with a zero byte.
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.sendto(state.encode(), address)
    except OSError as error:
        logger.warning("cannot notify the service manager (NOTIFY_SOCKET) of %s: %s", state, error)


def tell_reloading() -> None:
    """Report that settings are being reloaded (``Type=notify-reload``); :data:`READY` ends it."""
    tell(f"RELOADING=1\nMONOTONIC_USEC={time.monotonic_ns() // 1000}")


def heartbeat_seconds() -> float | None:
    """Return the interval of :data:`ALIVE` messages: half of ``WatchdogSec=``; None without a watchdog."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    is_meant = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    return int(microseconds) / 2e6 if is_meant and microseconds.isdecimal() and int(microseconds) else None


class Periodic:
    """Call that is repeated after so many seconds of a clock, until :meth:`close`."""

    def __init__(self, clock: Clock, seconds: float, call: Callable[[], object]) -> None:
        self._clock = clock
        self._seconds = seconds
        self._call = call
        self._timer: Timer = clock.call_later(seconds, self._run)

    def _run(self) -> None:
        self._call()
        self._timer = self._clock.call_later(self._seconds, self._run)

    def close(self) -> None:
        """Call no more."""
        self._timer.cancel()
