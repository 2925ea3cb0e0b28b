"""Formatting of times."""

from __future__ import annotations

from typing import Final

NANOSECONDS: Final = 1_000_000_000


def seconds(time_ns: int) -> str:
    """Format nanoseconds as seconds, exactly."""
    sign = "-" if time_ns < 0 else ""
    whole, rest = divmod(abs(time_ns), NANOSECONDS)
    return f"{sign}{whole}.{rest:09d}"
