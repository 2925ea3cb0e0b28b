"""`rwt serve` that tells what was asked of its event loop and its memory: `python -m
tests.faults.attacks.watched_server serve …`, with the arguments of `rwt`.

Each line of its input is answered by a line of JSON, a `Look`, and the line `cycles` by a number: see
:func:`_frozen_garbage`. The environment's `HOLDS_TO_TRACE` is a number
of seconds: where the loop's thread is, once it has held it for so long, goes to the log.
"""

from __future__ import annotations

import asyncio
import ctypes
import gc
import json
import os
import selectors
import sys
import threading
import time
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from rwt.cli import main

QUIET_YARDSTICK: Final = 0.010
"""Seconds that :func:`_yardstick` takes on a quiet machine of the kind on which 50 ms are meant."""


@dataclass(frozen=True, slots=True)
class Look:
    """Observed state of a server.

    Attributes:
        held: CPU seconds of the loop's thread between two looks at its sockets, at most, since it was asked;
            those of Python's garbage collector are among them.
        held_wall: seconds of the longest time between two looks, by the clock on the wall: other processes
            that ran meanwhile are included.
        collected: CPU seconds of the longest collection in that thread.
        used: MiB that are in use, as far as the C library knows: what it holds for later is left out.
        objects: how many small objects there are, in thousands.
        slowness: how many times longer the processor takes for something than a quiet one, at least 1.
    """

    held: float
    held_wall: float
    collected: float
    used: float
    objects: float
    slowness: float


class _WatchedSelector(selectors.DefaultSelector):
    """Notes the longest time between two looks at the sockets, in CPU seconds of the thread: other work on
    the machine does not count."""

    held = 0.0
    held_wall = 0.0
    collected = 0.0
    returned = 0.0
    returned_wall = 0.0
    looks = 0

    def select(self, timeout: float | None = None) -> Any:
        cls = _WatchedSelector
        cls.held = max(cls.held, time.thread_time() - cls.returned)
        cls.held_wall = max(cls.held_wall, time.monotonic() - cls.returned_wall)
        ready = super().select(timeout)
        cls.looks += 1
        cls.returned, cls.returned_wall = time.thread_time(), time.monotonic()
        return ready


class _MallInfo(ctypes.Structure):
    """Fields of mallinfo2(3), in bytes."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd",
                     "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")
    )  # fmt: skip


def _used() -> float:
    library = ctypes.CDLL(None)
    library.mallinfo2.restype = _MallInfo
    info = library.mallinfo2()
    return float(info.uordblks + info.hblkhd) / (1 << 20)


def _yardstick() -> float:
    begin, found = time.thread_time(), 0
    for number in range(200_000):
        found += number & 7
    assert found == 700_000
    return time.thread_time() - begin


def _frozen_garbage() -> int:
    """Return the number of objects that are garbage, but were frozen as members of cycles, and free them."""
    gc.collect()
    gc.unfreeze()
    found = gc.collect()
    gc.freeze()
    return found


def _answer() -> None:
    for line in sys.stdin:
        if line == "cycles\n":
            sys.stdout.write(f"{_frozen_garbage()}\n")
            sys.stdout.flush()
            continue
        gc.collect()
        yardstick = min(_yardstick() for _ in range(2))
        look = Look(
            _WatchedSelector.held,
            _WatchedSelector.held_wall,
            _WatchedSelector.collected,
            _used(),
            sys.getallocatedblocks() / 1000,
            max(1.0, yardstick / QUIET_YARDSTICK),
        )
        _WatchedSelector.held = _WatchedSelector.held_wall = _WatchedSelector.collected = 0.0
        sys.stdout.write(json.dumps(asdict(look)) + "\n")
        sys.stdout.flush()


def _trace(seconds: float, loop_thread: int, native: int) -> None:
    schedule = Path(f"/proc/self/task/{native}/schedstat")
    looks, began = 0, 0.0
    while True:
        time.sleep(seconds / 10)
        ran = int(schedule.read_text().split()[0]) / 1e9
        if looks != _WatchedSelector.looks or looks < 10:  # It is being begun.
            looks, began = _WatchedSelector.looks, ran
        elif ran - began > seconds and (frame := sys._current_frames().get(loop_thread)):
            lines = traceback.format_stack(frame)
            if "in select" not in lines[-1]:
                sys.stderr.write(f"held for {(ran - began) * 1000:.0f} ms\n{''.join(lines[-12:])}")
                sys.stderr.flush()


def _time_collections(loop_thread: int) -> None:
    """Note the longest collection in the loop's thread, which is part of the time for which the loop is
    held."""
    begun: list[float] = []

    def collecting(phase: str, info: dict[str, int]) -> None:
        if threading.get_ident() != loop_thread:
            return
        if phase == "start":
            begun.append(time.thread_time())
        elif begun:
            took = time.thread_time() - begun.pop()
            _WatchedSelector.collected = max(_WatchedSelector.collected, took)

    gc.callbacks.append(collecting)


def _time_callbacks(seconds: float) -> None:
    """Log each callback of the loop that takes longer."""
    run = asyncio.Handle._run

    def timed(handle: asyncio.Handle) -> None:
        began = time.thread_time()
        run(handle)
        if (took := time.thread_time() - began) > seconds:
            sys.stderr.write(f"{took * 1000:.0f} ms in {handle!r}\n")
            sys.stderr.flush()

    asyncio.Handle._run = timed  # type: ignore[method-assign, assignment]  # wrapped, to time each callback


def _watch() -> None:
    _time_collections(threading.get_ident())
    selectors.DefaultSelector = _WatchedSelector  # type: ignore[misc]  # asyncio looks the class up here
    threading.Thread(target=_answer, daemon=True).start()
    seconds = float(os.environ.get("HOLDS_TO_TRACE", "0"))
    if seconds:
        _time_callbacks(seconds / 2)
        own = threading.get_ident(), threading.get_native_id()
        threading.Thread(target=_trace, args=(seconds, *own), daemon=True).start()


if __name__ == "__main__":
    _watch()
    raise SystemExit(main())
