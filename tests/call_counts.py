"""Number of calls that an act makes: a measure of work that does not depend on the machine."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection


def count_calls(act: Callable[[], object], events: Collection[str] = ("call", "c_call")) -> int:
    """Return the number of functions called, of Python and C by default; see :func:`sys.setprofile`."""
    count = 0

    def note(frame: object, event: str, arg: object) -> None:
        nonlocal count
        count += event in events

    sys.setprofile(note)
    try:
        act()
    finally:
        sys.setprofile(None)
    return count
