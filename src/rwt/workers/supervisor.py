"""Several processes that do the same, started, watched and stopped by one parent that does nothing else.

The parent has no event loop and no threads, so that it can fork at any time; what it waits for are file
descriptors: those of its children and of its signals.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Final

from rwt_transports.backoff import Backoff

if TYPE_CHECKING:
    from multiprocessing.context import ForkProcess

logger = logging.getLogger(__name__)

Say = Callable[[str], None]
"""What a child calls once, when it is up, with anything that the parent should know."""

Work = Callable[[int, Say], int]
"""What each child does, given its number from 1 and a :data:`Say`; returns its exit code."""

_STOP_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
_AGAIN: Final = Backoff(first=0.5, factor=2.0, longest=30.0, jitter=0.0)
#: A child that has been up for so many seconds is started again without much waiting.
_SETTLED_SECONDS: Final = 60.0
#: Longer than a server takes to close its connections and to leave its graph.
_STOP_SECONDS: Final = 15.0


@dataclass(slots=True)
class _Child:
    number: int
    process: ForkProcess
    words: Connection
    started: float
    said: str | None = None


@dataclass(slots=True)
class _Place:
    """What outlives the children that take it one after the other."""

    delays: Iterator[float] = field(default_factory=_AGAIN.delays)
    due: float | None = None


class Supervisor:
    """Keeps a number of processes running until a signal comes.

    Args:
        count: how many.
        work: what each does.
        stop_seconds: how long they may take to end before they are killed.
    """

    def __init__(self, count: int, work: Work, stop_seconds: float = _STOP_SECONDS) -> None:
        self._work = work
        self._stop_seconds = stop_seconds
        self._children: dict[int, _Child] = {}
        self._places = {number: _Place() for number in range(1, count + 1)}
        self._context = multiprocessing.get_context("fork")

    def run(self, when_up: Say) -> int:
        """Start them, the first before the others, and watch until SIGINT or SIGTERM.

        Args:
            when_up: called when all are up, with what the first has said.

        Returns:
            The exit code: 0 after a signal; if one ended before all were up, its own; 1 if some had to be
            killed.
        """
        with _signals() as signals:
            try:
                for numbers in ([1], [number for number in self._places if number > 1]):
                    for number in numbers:
                        self._start(number)
                    if (code := self._await_up(signals)) is not None:
                        return self._stop() or code
                when_up(self._children[1].said or "")
                self._watch(signals)
            except BaseException:
                self._stop()
                raise
            return self._stop()

    def _start(self, number: int) -> None:
        words, child_end = self._context.Pipe(duplex=False)
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
        self._places[number].due = None
        self._children[number] = _Child(number, process, words, time.monotonic())

    def _await_up(self, signals: socket.socket) -> int | None:
        """None when all that were started are up; else the exit code, after a signal or a failure."""
        while any(child.said is None for child in self._children.values()):
            ready = self._wait(signals)
            if signals in ready:
                return 0
            for child in self._ended(ready):
                return child.process.exitcode or 1
        return None

    def _watch(self, signals: socket.socket) -> None:
        """Start again what ends, until a signal comes."""
        while True:
            ready = self._wait(signals)
            if signals in ready:
                return
            for child in self._ended(ready):
                self._plan_again(child)
            now = time.monotonic()
            for number, place in self._places.items():
                if place.due is not None and place.due <= now:
                    self._start(number)

    def _wait(self, signals: socket.socket | None, longest: float | None = None) -> list[object]:
        """What has happened, after it has: signals and sentinels; what children say is noted."""
        now = time.monotonic()
        dues = [place.due - now for place in self._places.values() if place.due is not None]
        if longest is not None:
            dues.append(longest)
        handles: list[Connection | socket.socket | int] = [] if signals is None else [signals]
        for child in self._children.values():
            handles += [child.process.sentinel, *([child.words] if child.said is None else [])]
        ready = wait(handles, max(0.0, min(dues)) if dues else None)
        for child in self._children.values():
            if child.words in ready:
                _note(child)
        return [*ready]

    def _ended(self, ready: list[object]) -> list[_Child]:
        """Those that have ended, forgotten and waited for."""
        ended = [child for child in self._children.values() if child.process.sentinel in ready]
        for child in ended:
            child.process.join()
            child.words.close()
            del self._children[child.number]
        return ended

    def _plan_again(self, child: _Child) -> None:
        place = self._places[child.number]
        if time.monotonic() - child.started >= _SETTLED_SECONDS:
            place.delays = _AGAIN.delays()
        delay = next(place.delays)
        place.due = time.monotonic() + delay
        logger.error(
            "worker %d (process %s) ended%s; it is started again in %g s",
            child.number,
            child.process.pid,
            _how(child.process.exitcode),
            delay,
        )

    def _stop(self) -> int:
        """End all; 1 if some had to be killed or failed to end well."""
        for place in self._places.values():
            place.due = None
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
        # One that was told to end before it had begun to listen for it was ended by the signal.
        return int(any(code not in (0, -signal.SIGTERM) for code in codes))


def _note(child: _Child) -> None:
    try:
        child.said = str(child.words.recv())
    except EOFError:
        child.said = ""  # It ends without having been up, which its sentinel tells too.
    else:
        logger.info("worker %d is up, as process %s", child.number, child.process.pid)


def _how(code: int | None) -> str:
    if code is not None and code < 0:
        return f" by {signal.Signals(-code).name}"
    return f" with exit code {code}"


def _child(work: Work, number: int, words: Connection) -> None:
    """What a child runs first: it must not take its parent's signals for its own."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOP_SIGNALS)
    sys.exit(work(number, words.send))


def parent_sentinel() -> int:
    """In a child: a file descriptor that becomes readable when its parent has died, however that was."""
    parent = multiprocessing.parent_process()
    assert parent is not None  # Only children ask.
    return parent.sentinel


def parent_lives() -> bool:
    """In a child: whether its parent has not died yet."""
    parent = multiprocessing.parent_process()
    return parent is not None and parent.is_alive()


@contextmanager
def _signals() -> Iterator[socket.socket]:
    """A socket that becomes readable when the process is told to stop."""
    reader, writer = socket.socketpair()
    with reader, writer:
        writer.setblocking(False)
        before = {number: signal.signal(number, lambda *_: None) for number in _STOP_SIGNALS}
        wakeup = signal.set_wakeup_fd(writer.fileno())
        try:
            yield reader
        finally:
            signal.set_wakeup_fd(wakeup)
            for number, handler in before.items():
                signal.signal(number, handler)


__all__ = ["Say", "Supervisor", "Work", "parent_lives", "parent_sentinel"]
