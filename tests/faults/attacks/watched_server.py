"""`rwt serve` that tells what was asked of its event loop and its memory: `python -m
tests.faults.attacks.watched_server serve …`, with the arguments of `rwt`.

Each line of its input is answered by a line of JSON, a `Look`. The environment's `HOLDS_TO_TRACE` is a number
of seconds: where the loop's thread is, once it has held it for so long, goes to the log.
"""

from __future__ import annotations

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
from typing import Any, Final

from rwt_cli import main

QUIET_YARDSTICK: Final = 0.010
"""Seconds that :func:`_yardstick` takes on a quiet machine of the kind on which 50 ms are meant."""


@dataclass(frozen=True, slots=True)
class Look:
    """What is seen of a server.

    Attributes:
        held: CPU seconds of the loop's thread between two looks at its sockets, at most, since it was asked.
        used: MiB that are in use, as far as the C library knows: what it holds for later is left out.
        objects: how many small objects there are, in thousands.
        slowness: how many times longer the processor takes for something than a quiet one, at least 1.
    """

    held: float
    used: float
    objects: float
    slowness: float


class _WatchedSelector(selectors.DefaultSelector):
    """Notes the longest time between two looks at the sockets, in CPU seconds of the thread: other work on
    the machine does not count."""

    held = 0.0
    returned = 0.0
    looks = 0

    def select(self, timeout: float | None = None) -> Any:
        cls = _WatchedSelector
        cls.held = max(cls.held, time.thread_time() - cls.returned)
        ready = super().select(timeout)
        cls.looks += 1
        cls.returned = time.thread_time()
        return ready


class _MallInfo(ctypes.Structure):
    """What mallinfo2(3) says, in bytes."""

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


def _answer() -> None:
    for _ in sys.stdin:
        gc.collect()
        yardstick = min(_yardstick() for _ in range(2))
        look = Look(
            _WatchedSelector.held,
            _used(),
            sys.getallocatedblocks() / 1000,
            max(1.0, yardstick / QUIET_YARDSTICK),
        )
        _WatchedSelector.held = 0.0
        sys.stdout.write(json.dumps(asdict(look)) + "\n")
        sys.stdout.flush()


def _trace(seconds: float, loop_thread: int) -> None:
    seen = (0, 0.0)
    while True:
        time.sleep(seconds / 10)
        looks, now = _WatchedSelector.looks, time.monotonic()
        if looks != seen[0] or looks < 10:  # It is being begun.
            seen = (looks, now)
        elif now - seen[1] > seconds and (frame := sys._current_frames().get(loop_thread)):
            lines = traceback.format_stack(frame)
            if "in select" not in lines[-1]:
                sys.stderr.write(f"held for {(now - seen[1]) * 1000:.0f} ms\n{''.join(lines[-12:])}")
                sys.stderr.flush()


def _watch() -> None:
    selectors.DefaultSelector = _WatchedSelector  # type: ignore[misc]  # what asyncio makes its loops with
    threading.Thread(target=_answer, daemon=True).start()
    seconds = float(os.environ.get("HOLDS_TO_TRACE", "0"))
    if seconds:
        threading.Thread(target=_trace, args=(seconds, threading.get_ident()), daemon=True).start()


if __name__ == "__main__":
    _watch()
    raise SystemExit(main())
