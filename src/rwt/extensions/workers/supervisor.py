"""Supervisor process that starts, watches and stops worker processes.

It has no event loop and no threads, so that it can fork at any time. It waits for file descriptors: those of
its children and of its signals.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Final

from rwt.observability.supervision import (
    ALIVE,
    READY,
    STOPPING,
    heartbeat_seconds,
    tell,
    tell_reloading,
)
from rwt.signals import HANGUP, terminal_is_gone
from rwt_transports.backoff import Backoff

if TYPE_CHECKING:
    from multiprocessing.context import ForkProcess

logger = logging.getLogger(__name__)

Announce = Callable[[str], None]
"""Callback of a child, called once when it is up, with a text for the supervisor."""

ChildMain = Callable[[int, Announce], int]
"""Main function of a child, given its number from 1 and an :data:`Announce`; returns the exit code."""

_STOP_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
#: SIGHUP is passed on to the children, which then reload their files.
_SIGNALS: Final = _STOP_SIGNALS if HANGUP is None else (*_STOP_SIGNALS, HANGUP)
_RESTART: Final = Backoff(first=0.5, factor=2.0, longest=30.0, jitter=0.0)
#: Uptime after which the restart delay of a child is reset.
_SETTLED_SECONDS: Final = 60.0
#: Default grace period: longer than a server takes to close its connections and its graph.
_STOP_SECONDS: Final = 15.0


@dataclass(slots=True)
class _Child:
    number: int
    process: ForkProcess
    pipe: Connection
    started: float
    announced: str | None = None


@dataclass(slots=True)
class _Restarts:
    """Restart schedule of one worker number."""

    delays: Iterator[float] = field(default_factory=_RESTART.delays)
    due: float | None = None


class Supervisor:
    """Keeps a number of processes running until a signal arrives.

    Args:
        count: number of processes.
        stop_seconds: time to end before a process is killed.
    """

    def __init__(self, count: int, work: ChildMain, stop_seconds: float = _STOP_SECONDS) -> None:
        self._work = work
        self._stop_seconds = stop_seconds
        self._children: dict[int, _Child] = {}
        self._restarts = {number: _Restarts() for number in range(1, count + 1)}
        self._context = multiprocessing.get_context("fork")

    def run(self, when_up: Announce) -> int:
        """Start the workers, the first before the others, and watch them until SIGINT or SIGTERM.

        Args:
            when_up: called when all are up, with the text of the first.

        Returns:
            The exit code: 0 after a signal; that of a worker that ended before all were up; 1 if one was
                killed.
        """
        with _signals() as signals:
            try:
                for numbers in ([1], [number for number in self._restarts if number > 1]):
                    for number in numbers:
                        self._start(number)
                    if (code := self._await_up(signals)) is not None:
                        return self._stop() or code
                when_up(self._children[1].announced or "")
                tell(READY)
                self._watch(signals)
            except BaseException:
                self._stop()
                raise
            tell(STOPPING)
            return self._stop()

    def _start(self, number: int) -> None:
        pipe, child_end = self._context.Pipe(duplex=False)
        process = self._context.Process(
            target=_child, args=(self._work, number, child_end), name=f"worker {number}"
        )
        # A signal between the fork and the child's own handlers would be lost.
        held = signal.pthread_sigmask(signal.SIG_BLOCK, _STOP_SIGNALS)
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, held)
        child_end.close()
        self._restarts[number].due = None
        self._children[number] = _Child(number, process, pipe, time.monotonic())

    def _await_up(self, signals: socket.socket) -> int | None:
        """Return None once all started workers are up, else the exit code: after a signal or a failure."""
        while any(child.announced is None for child in self._children.values()):
            ready = self._wait(signals)
            if signals in ready and any(number in _STOP_SIGNALS for number in signals.recv(64)):
                return 0
            for child in self._ended(ready):
                return child.process.exitcode or 1
        return None

    def _watch(self, signals: socket.socket) -> None:
        heartbeat = heartbeat_seconds()
        while True:
            ready = self._wait(signals, heartbeat)
            if heartbeat is not None:
                tell(ALIVE)
            if signals in ready:
                if any(number in _STOP_SIGNALS for number in signals.recv(64)) or terminal_is_gone():
                    return
                tell_reloading()
                for child in self._children.values():
                    if child.process.pid is not None and HANGUP is not None:
                        os.kill(child.process.pid, HANGUP)
                tell(READY)
            for child in self._ended(ready):
                self._schedule_restart(child)
            now = time.monotonic()
            for number, restarts in self._restarts.items():
                if restarts.due is not None and restarts.due <= now:
                    self._start(number)

    def _wait(self, signals: socket.socket | None, longest: float | None = None) -> list[object]:
        """Wait for events, and return the ready signals and sentinels; announcements are stored."""
        now = time.monotonic()
        dues = [restarts.due - now for restarts in self._restarts.values() if restarts.due is not None]
        if longest is not None:
            dues.append(longest)
        handles: list[Connection | socket.socket | int] = [] if signals is None else [signals]
        for child in self._children.values():
            handles += [child.process.sentinel, *([child.pipe] if child.announced is None else [])]
        ready = wait(handles, max(0.0, min(dues)) if dues else None)
        for child in self._children.values():
            if child.pipe in ready:
                _read_announcement(child)
        return [*ready]

    def _ended(self, ready: list[object]) -> list[_Child]:
        ended = [child for child in self._children.values() if child.process.sentinel in ready]
        for child in ended:
            child.process.join()
            child.pipe.close()
            del self._children[child.number]
        return ended

    def _schedule_restart(self, child: _Child) -> None:
        restarts = self._restarts[child.number]
        if time.monotonic() - child.started >= _SETTLED_SECONDS:
            restarts.delays = _RESTART.delays()
        delay = next(restarts.delays)
        restarts.due = time.monotonic() + delay
        logger.error(
            "worker %d (process %s) ended%s; it is started again in %g s",
            child.number,
            child.process.pid,
            _ending(child.process.exitcode),
            delay,
        )

    def _stop(self) -> int:
        """Stop all workers. Returns 1 if one was killed or failed, else 0."""
        for restarts in self._restarts.values():
            restarts.due = None
        for child in self._children.values():
            child.process.terminate()
        until = time.monotonic() + self._stop_seconds
        codes = []
        while self._children and (left := until - time.monotonic()) > 0:
            codes += [child.process.exitcode for child in self._ended(self._wait(None, left))]
        for child in self._children.values():
            logger.error("worker %d has not ended in %g s: killing it", child.number, self._stop_seconds)
            child.process.kill()
            child.process.join()
            codes.append(child.process.exitcode)
        self._children.clear()
        # SIGTERM ends a child that has not installed its handler yet.
        return int(any(code not in (0, -signal.SIGTERM) for code in codes))


def _read_announcement(child: _Child) -> None:
    try:
        child.announced = str(child.pipe.recv())
    except EOFError:
        child.announced = ""  # Ended before it was up; its sentinel reports that.
    else:
        logger.info("worker %d is up, as process %s", child.number, child.process.pid)


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        return f" by {signal.Signals(-code).name}"
    return f" with exit code {code}"


def _child(work: ChildMain, number: int, pipe: Connection) -> None:
    """Run a child: drop the parent's signal handling, then work."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOP_SIGNALS)
    sys.exit(work(number, pipe.send))


def parent_sentinel() -> int:
    """Return a file descriptor that becomes readable when the parent has died. Only in a child."""
    parent = multiprocessing.parent_process()
    assert parent is not None  # Only children ask.
    return parent.sentinel


def parent_lives() -> bool:
    """True if the parent is alive. Only in a child."""
    parent = multiprocessing.parent_process()
    return parent is not None and parent.is_alive()


@contextmanager
def _signals() -> Iterator[socket.socket]:
    """Yield a socket that delivers the numbers of SIGINT, SIGTERM and SIGHUP."""
    reader, writer = socket.socketpair()
    with reader, writer:
        writer.setblocking(False)
        before = {number: signal.signal(number, lambda *_: None) for number in _SIGNALS}
        wakeup = signal.set_wakeup_fd(writer.fileno())
        try:
            yield reader
        finally:
            signal.set_wakeup_fd(wakeup)
            for number, handler in before.items():
                signal.signal(number, handler)
