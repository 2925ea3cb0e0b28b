"""Keeps Python's collector of cyclic garbage from holding the event loop of a server.

A full collection looks at every object that the process has, a million of them in half a second, and comes
when much has been made: in the midst of a client's message. So full collections are made here, between two
messages, and each time only so much is left to be looked at again as takes some milliseconds: beyond that,
what has survived is frozen, which means that it is never looked at again.

What is frozen is freed like everything when nothing refers to it any more; only cycles of objects that became
garbage after they were frozen would stay. What clients have is made without cycles, or these are cut when it
ends (`tests/faults/test_garbage.py` holds that).
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from typing import Final, Literal

MOST_LOOKED_AT: Final = 10_000
"""Objects that are left to be looked at again."""

_OFTEN: Final = 2
"""Collections of young objects, of some thousand at most each, after which all are looked at."""

_NEVER: Final = 1 << 30


class BoundedGarbageCollection:
    """Makes the full collections of this process, each a short one.

    Args:
        soon: calls what it is given on the event loop, after what runs there now.
    """

    def __init__(self, soon: Callable[[Callable[[], None]], object]) -> None:
        self._soon = soon
        self._loop_thread = threading.get_ident()
        self._is_due = False

    def begin(self) -> None:
        """Look at everything once, on the event loop, and make full collections from now on."""
        young, middle, _ = gc.get_threshold()
        gc.set_threshold(young, middle, _NEVER)
        gc.collect()
        gc.freeze()
        gc.callbacks.append(self._note)

    def end(self) -> None:
        """Leave full collections to Python again."""
        gc.callbacks.remove(self._note)
        young, middle, _ = gc.get_threshold()
        gc.set_threshold(young, middle, 10)
        gc.unfreeze()

    def _note(self, phase: Literal["start", "stop"], info: dict[str, int]) -> None:
        # Another thread may collect, too; the next time it is this one.
        if phase == "stop" and not self._is_due and threading.get_ident() == self._loop_thread:
            self._is_due = gc.get_count()[2] >= _OFTEN
            if self._is_due:
                self._soon(self._collect)

    def _collect(self) -> None:
        self._is_due = False
        gc.collect()
        if len(gc.get_objects(2)) > MOST_LOOKED_AT:
            gc.freeze()
